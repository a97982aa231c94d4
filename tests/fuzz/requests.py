"""Requests as bytes: valid ones for the service and for the page, and what a request says, so that it can be
spoilt.
"""

from pathlib import Path
from typing import Any

from tests.fuzz.edits import Form
from tests.insertion.glbs import png

_PNG = png((128, 255, 51)).decode("latin-1")
_BOUNDARY = "8f14e45fceea167a"
_END = "\r\n"
_CAMERA = (
    '{"camera_to_world": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 3], [0, 0, 0, 1]], '
    '"fx": 9, "fy": 9, "cx": 4, "cy": 4, "width": 8, "height": 8}'
)


def _request(method: str, target: str, headers: dict[str, str] | None = None, **rest: Any) -> dict[str, Any]:
    return {
        "method": method,
        "target": target,
        "headers": [list(one) for one in (headers or {}).items()],
        **rest,
    }


def _field(name: str, value: str, file: str | None = None) -> dict[str, Any]:
    return {"name": name, "file": file, "value": value}


def _predict(
    *fields: dict[str, Any], name: str = "cup", photo: str = "good.png", **headers: str
) -> dict[str, Any]:
    named = {"host": "127.0.0.1", **{key.replace("_", "-"): value for key, value in headers.items()}}
    return _request(
        "POST",
        f"/objects/{name}/predict",
        named,
        fields=[_field("photo", _PNG, photo), *fields],
    )


def service_requests() -> dict[str, bytes]:
    """Return valid requests for the service, by what their files are called; "token-" asks one that has a
    token.
    """
    all_fields = (
        _field("camera", _CAMERA),
        _field("mask", _PNG, "mask.png"),
        _field("method", "solve"),
        _field("size", "512x256"),
        _field("sun", "separate"),
        _field("sources", "true"),
        _field("background", "false"),
        _field("formats", "exr,hdr"),
        _field("formats", "confidence"),
        _field("deadline", "9.5"),
    )
    told = {
        "accept": "application/json;q=0.5, application/zip;q=0.9",
        "x_request_id": "mine-1",
        "range": "bytes=0-9",
    }
    requests = {
        "all.http": _predict(*all_fields),
        "camera-file.http": _predict(
            _field("camera", _CAMERA, "camera.json"), accept="image/x-exr", range="bytes=0-9"
        ),
        "zip.http": _predict(_field("formats", "exr"), **told),
        "chunked.http": _predict(transfer_encoding="chunked", expect="100-continue"),
        **{
            f"{what}.http": _predict(photo=f"{what}.png")
            for what in ("dies", "once", "fails", "full", "breaks")
        },
        "token-right.http": _predict(authorization="Bearer a-token-that-is-long-enough"),
        "list.http": _request("GET", "/objects?after=a&limit=3", {"host": "localhost:8422", "accept": "*/*"}),
        "one.http": _request("GET", "/objects/cup", {"host": "[::1]", "sec-fetch-site": "same-origin"}),
    }
    files = {name: written(b"", request) for name, request in requests.items()}
    two = (
        _request("GET", path, {"host": "127.0.0.1"})
        for path in ("/health", "/ready", "/metrics", "/openapi.json")
    )
    files["several.http"] = (
        b"".join(written(b"", one) for one in two) + files["zip.http"] + files["list.http"]
    )
    return files


def page_requests(photo: bytes, light: bytes, thing: bytes) -> dict[str, bytes]:
    """Return valid requests for the page; JOB, LIGHT and THING in an address or body stand for ids of before."""
    own = {"host": "127.0.0.1:8421", "x-lightprobe": "1", "origin": "http://127.0.0.1:8421"}

    def given(target: str, name: str, body: bytes, method: str = "POST") -> dict[str, Any]:
        return _request(method, target, {**own, "x-file-name": name}, body=body.decode("latin-1"))

    placement = '{"thing": "THING", "at": [0.5, 0.25], "scale": 1.5, "turn": 30}'
    kinds = {**own, "content-type": "application/json"}
    requests = {
        "page-photo.http": given("/api/runs/0/predictions", "good.png", photo),
        "page-fails.http": given("/api/runs/0/predictions", "fails.png", photo),
        "page-light.http": given("/api/lights", "..%2Fsky.exr", light),
        "page-thing.http": given("/api/things", "box.glb", thing),
        "page-mask.http": given("/api/scenes/0/photos/0/mask", "mask.png", photo, "PUT"),
        "page-box.http": _request(
            "PUT", "/api/scenes/0/box", kinds, body='{"photo": 0, "box": [0.1, 0.2, 0.8, 0.9]}'
        ),
        "page-insert.http": _request("POST", "/api/jobs/JOB/insertions", kinds, body=placement),
        "page-stop.http": _request("POST", "/api/jobs/JOB/stop", own),
        "page-job.http": _request(
            "GET", "/api/jobs/JOB/files/light.exr?save=true", {**own, "range": "bytes=1-3"}
        ),
        "page-given.http": _request("GET", "/api/lights/LIGHT", own),
        "page-run.http": _request("GET", "/api/runs/0/photos/1/light", own),
        "page-training.http": _request("GET", "/api/runs/0/training?after=10", own),
        "page-static.http": _request(
            "GET", "/static/js/app.js", {**own, "if-none-match": '"x"', "range": "bytes=3-8"}
        ),
        "page-token.http": _request(
            "GET", "/?token=a-token", {**own, "cookie": "lightprobe-8421=a-token; b=c"}
        ),
    }
    return {name: written(b"", request) for name, request in requests.items()}


def described(data: bytes) -> Any:
    """Return the first of the requests in `data`, whose form is that of `written`, as a JSON value."""
    head, _, body = data.decode("latin-1").partition(_END * 2)
    line, *lines = head.split(_END)
    method, target, _ = line.split(" ")
    headers = [
        list(one.split(": ", 1))
        for one in lines
        if not one.startswith(("content-length", "content-type: multi"))
    ]
    value = {"method": method, "target": target, "headers": headers}
    if "content-type: multipart/form-data" not in head:
        return {**value, "body": body}
    if ["transfer-encoding", "chunked"] in headers:
        body = body.partition(_END)[2]
    parts = [part.partition(_END * 2) for part in body.split(f"--{_BOUNDARY}")[1:-1]]
    return {**value, "fields": [_part(head, content.removesuffix(_END)) for head, _, content in parts]}


def _part(head: str, content: str) -> dict[str, Any]:
    names = [piece.split('"')[0] for piece in head.split('name="')[1:]]
    return _field(names[0], content, names[1] if len(names) > 1 else None)


def written(valid: bytes, value: Any) -> bytes:
    """Return the request that a JSON value says, whatever parts of it are, with a length that is right."""
    request = value if isinstance(value, dict) else {}
    headers = [_pair(one) for one in _listed(request.get("headers"))]
    body = _bytes(request.get("body", ""))
    if "fields" in request:
        body = b"".join(map(_form_part, _listed(request["fields"]))) + f"--{_BOUNDARY}--{_END}".encode()
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
    return (
        before + name + str(len(body)).encode() + b"\r\n".join([b"", *after.split(b"\r\n")[1:]]) + gap + body
        if name
        else data
    )


def _listed(value: Any) -> list[Any]:
    return value if isinstance(value, list) else []


def _pair(one: Any) -> tuple[bytes, bytes]:
    name, value = one if isinstance(one, list) and len(one) == 2 else ("x", one)
    return _bytes(name), _bytes(value)


def _form_part(part: Any) -> bytes:
    known = part if isinstance(part, dict) else {"value": part}
    file = known.get("file")
    named = b'; filename="%s"' % _bytes(file) if file is not None else b""
    return b"\r\n".join(
        [
            f"--{_BOUNDARY}".encode(),
            b'content-disposition: form-data; name="%s"%s' % (_bytes(known.get("name")), named),
            b"",
            _bytes(known.get("value")),
            b"",
        ]
    )


def _bytes(value: Any) -> bytes:
    text = str(value)
    try:
        return text.encode("latin-1")
    except UnicodeEncodeError:
        return text.encode("utf-8", "surrogatepass")


REQUEST = Form(described, written)


def write(folder: Path, files: dict[str, bytes]) -> None:
    """Write requests into a folder, which is made."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, data in files.items():
        (folder / name).write_bytes(data)
