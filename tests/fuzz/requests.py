"""Requests as bytes: valid ones for the service and for the page, and what a request says, so that it can be
spoilt.
"""

from pathlib import Path
from typing import Any

from tests.fuzz.edits import Form
from tests.insertion.glbs import png

_PNG = png((128, 255, 51)).decode("latin-1")
_BOUNDARY = "8f14e45fceea167a"
_CAMERA = (
    '{"camera_to_world": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 3], [0, 0, 0, 1]], '
    '"fx": 9, "fy": 9, "cx": 4, "cy": 4, "width": 8, "height": 8}'
)
_SAID: dict[bytes, Any] = {}  # what valid requests were written from


def _request(method: str, target: str, headers: dict[str, str], **rest: Any) -> dict[str, Any]:
    return {"method": method, "target": target, "headers": [list(one) for one in headers.items()], **rest}


def _predict(*fields: tuple[str, ...], photo: str = "good.png", **headers: str) -> dict[str, Any]:
    named = {"host": "127.0.0.1", **{key.replace("_", "-"): value for key, value in headers.items()}}
    return _request(
        "POST", "/objects/cup/predict", named, fields=[["photo", _PNG, photo], *map(list, fields)]
    )


def service_requests() -> dict[str, Any]:
    """Return valid requests for the service by their files' names; "token-" asks a service that has a token."""
    all_fields = (
        ("camera", _CAMERA),
        ("mask", _PNG, "mask.png"),
        ("method", "solve"),
        ("size", "512x256"),
        ("sun", "separate"),
        ("sources", "true"),
        ("background", "false"),
        ("formats", "exr,hdr"),
        ("formats", "confidence"),
        ("deadline", "9.5"),
    )
    kinds = "application/json;q=0.5, application/zip;q=0.9"
    what = ("dies", "once", "fails", "full", "breaks")
    local = {"host": "127.0.0.1"}
    requests: dict[str, Any] = {
        "all": _predict(*all_fields),
        "camera-file": _predict(("camera", _CAMERA, "camera.json"), accept="image/x-exr", range="bytes=0-9"),
        "zip": _predict(("formats", "exr"), accept=kinds, x_request_id="mine-1", range="bytes=0-9"),
        "chunked": _predict(transfer_encoding="chunked", expect="100-continue"),
        **{one: _predict(photo=f"{one}.png") for one in what},
        "token-right": _predict(authorization=f"Bearer {'a-token-that-is-long-enough'}"),
        "list": _request("GET", "/objects?after=a&limit=3", {"host": "localhost:8422", "accept": "*/*"}),
        "one": _request("GET", "/objects/cup", {"host": "[::1]", "sec-fetch-site": "same-origin"}),
    }
    paths = ("/health", "/ready", "/metrics", "/openapi.json")
    several = [*(_request("GET", path, local) for path in paths), requests["zip"], requests["list"]]
    return {**requests, "several": several}


def page_requests(photo: bytes, light: bytes, glb: bytes) -> dict[str, Any]:
    """Return valid requests for the page; TASK, LIGHT and OBJECT in an address or body stand for ids of before."""
    own = {"host": "127.0.0.1:8421", "x-lightprobe": "1", "origin": "http://127.0.0.1:8421"}
    kinds = {**own, "content-type": "application/json"}
    placement = '{"object": "OBJECT", "at": [0.5, 0.25], "scale": 1.5, "turn": 30}'
    box = '{"photo": 0, "box": [0.1, 0.2, 0.8, 0.9]}'

    def given(target: str, name: str, body: bytes, method: str = "POST") -> dict[str, Any]:
        return _request(method, target, {**own, "x-file-name": name}, body=body.decode("latin-1"))

    return {
        "photo": given("/api/runs/0/predictions", "good.png", photo),
        "fails": given("/api/runs/0/predictions", "fails.png", photo),
        "light": given("/api/lights", "..%2Fsky.exr", light),
        "object": given("/api/objects", "box.glb", glb),
        "mask": given("/api/scenes/0/photos/0/mask", "mask.png", photo, "PUT"),
        "box": _request("PUT", "/api/scenes/0/box", kinds, body=box),
        "insert": _request("POST", "/api/tasks/TASK/insertions", kinds, body=placement),
        "stop": _request("POST", "/api/tasks/TASK/stop", own),
        "task": _request("GET", "/api/tasks/TASK/files/light.exr?save=true", {**own, "range": "bytes=1-3"}),
        "given": _request("GET", "/api/lights/LIGHT", own),
        "run": _request("GET", "/api/runs/0/photos/1/light", own),
        "training": _request("GET", "/api/runs/0/training?after=10", own),
        "static": _request("GET", "/static/js/app.js", {**own, "if-none-match": '"x"', "range": "bytes=3-8"}),
        "token": _request("GET", "/?token=a-token", {**own, "cookie": "lightprobe-8421=a-token; b=c"}),
    }


def write(folder: Path, requests: dict[str, Any]) -> None:
    """Write requests into a folder, which is made."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, said in requests.items():
        data = b"".join(_written(one) for one in said) if isinstance(said, list) else _written(said)
        _SAID[data] = said[0] if isinstance(said, list) else said
        (folder / f"{name}.http").write_bytes(data)


def _written(value: Any) -> bytes:
    """Return the request that a JSON value says, whatever parts of it are, with a length that is right."""
    request = value if isinstance(value, dict) else {}
    headers = [_pair(one) for one in _listed(request.get("headers"))]
    body = _bytes(request.get("body", ""))
    if "fields" in request:
        body = b"".join(map(_form_part, _listed(request["fields"]))) + f"--{_BOUNDARY}--\r\n".encode()
        headers.append((b"content-type", f"multipart/form-data; boundary={_BOUNDARY}".encode()))
    if (b"transfer-encoding", b"chunked") in headers:
        body = b"%x\r\n%s\r\n0\r\n\r\n" % (len(body), body)
    elif body:
        headers.append((b"content-length", str(len(body)).encode()))
    line = b" ".join((_bytes(request.get("method")), _bytes(request.get("target")), b"HTTP/1.1"))
    return b"\r\n".join([line, *(b"%s: %s" % pair for pair in headers), b"", body])


def with_length(data: bytes) -> bytes:
    """Return a request whose announced length is that of its body, where it announces one."""
    head, gap, body = data.partition(b"\r\n\r\n")
    before, name, after = head.partition(b"content-length: ")
    if not name:
        return data
    rest = b"\r\n".join([b"", *after.split(b"\r\n")[1:]])
    return before + name + str(len(body)).encode() + rest + gap + body


def _listed(value: Any) -> list[Any]:
    return value if isinstance(value, list) else []


def _pair(one: Any) -> tuple[bytes, bytes]:
    name, value = one if isinstance(one, list) and len(one) == 2 else ("x", one)
    return _bytes(name), _bytes(value)


def _form_part(part: Any) -> bytes:
    name, value, *file = part if isinstance(part, list) and len(part) > 1 else (part, part)
    named = b'; filename="%s"' % _bytes(file[0]) if file else b""
    disposition = b'content-disposition: form-data; name="%s"%s' % (_bytes(name), named)
    return b"\r\n".join([f"--{_BOUNDARY}".encode(), disposition, b"", _bytes(value), b""])


def _bytes(value: Any) -> bytes:
    text = str(value)
    try:
        return text.encode("latin-1")
    except UnicodeEncodeError:
        return text.encode("utf-8", "surrogatepass")


REQUEST = Form(_SAID.__getitem__, lambda data, value: _written(value))
