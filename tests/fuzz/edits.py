"""How a valid file is spoilt: bytes replaced, cut or copied, and parts of what it says replaced by odd
values.

Every way is a strategy of hypothesis, so that a seed names the spoilt files, and a list of edits, so that a
finding is made smaller by leaving edits away.
"""

import contextlib
import json
import math
import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import hypothesis
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

NUMBERS = st.sampled_from([0, -1, 1, 1e-320, 1e-9, 1e9, 1e200, -1e308, 10**400, 2**63, math.inf, math.nan])
TEXTS = st.sampled_from(
    ["", ".", "..", "/", "~", "\0", "\ud800", "\n", "a" * 300, "images", "images/view_01.jpg", "1e999"]
)
VALUES = st.recursive(
    NUMBERS | TEXTS | st.booleans() | st.none(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(TEXTS, inner, max_size=2),
    max_leaves=6,
)
_EXTREMES = (
    0,
    1,
    2,
    127,
    128,
    255,
    2**15 - 1,
    2**16 - 1,
    2**31 - 1,
    2**31,
    2**32 - 1,
    2**40,
    2**63 - 1,
    2**64 - 1,
)
_WORDS = (b"\n", b" ", b"-1", b"1e999", b"nan", b"4294967296", b"PK\x03\x04", b"\xff" * 16, bytes(16))


@dataclass(frozen=True)
class Splice:
    """Bytes from `at` on, of which `removed` go and `new` come: these, or a stretch of the file, (start, length)."""

    at: int  # counted around the file's length, as start is
    removed: int
    new: bytes | tuple[int, int]

    def apply(self, data: bytes) -> bytes:
        """Return the spoilt file."""
        at, new = self.at % (len(data) + 1), self.new
        if isinstance(new, tuple):
            new = data[new[0] % (len(data) + 1) :][: new[1]]
        return data[:at] + new + data[at + self.removed :]


@dataclass(frozen=True)
class Replacement:
    """A part of a JSON value replaced; `path` leads to it, each step counted around the number of parts there
    are.
    """

    path: tuple[int, ...]
    new: Any

    def apply_to(self, value: Any) -> Any:
        """Return the value with the part replaced."""
        keys: list[Any] = []
        inner = value
        for step in self.path:
            if not isinstance(inner, dict | list) or not inner:
                break
            keys.append(sorted(inner)[step % len(inner)] if isinstance(inner, dict) else step % len(inner))
            inner = inner[keys[-1]]
        return replaced(value, tuple(keys), self.new)


@dataclass(frozen=True)
class Form:
    """What a file says, as a JSON value, and the file that says it."""

    read: Callable[[bytes], Any]
    write: Callable[[bytes, Any], bytes]  # of the valid file and the value


def replaced(value: Any, path: tuple, new: Any) -> Any:
    """Return a copy of a JSON value with the part at `path` replaced."""
    if not path:
        return new
    copy = dict(value) if isinstance(value, dict) else list(value)
    copy[path[0]] = replaced(value[path[0]], path[1:], new)
    return copy


def byte_edits() -> st.SearchStrategy:
    """Return lists of one to four edits of bytes; half of them near the beginning, where headers are."""
    place = st.integers(0, 128) | st.integers(0, 2**16)
    number = st.tuples(
        st.sampled_from(_EXTREMES), st.sampled_from((1, 2, 4, 8)), st.sampled_from(("little", "big"))
    )
    numbers = number.map(lambda given: (given[0] % 256 ** given[1]).to_bytes(given[1], given[2]))
    new = numbers | numbers | st.binary(min_size=1, max_size=8) | st.sampled_from(_WORDS)
    over = st.tuples(place, new).map(lambda given: Splice(given[0], len(given[1]), given[1]))
    other = st.builds(Splice, place, st.integers(0, 64), new) | st.builds(
        Splice, place, st.just(2**31), st.just(b"")
    )
    stretch = st.tuples(place, st.integers(1, 4096))
    copied = st.tuples(place, stretch, st.booleans())
    copy = copied.map(lambda given: Splice(given[0], given[1][1] * given[2], given[1]))
    edit = over | over | other | copy
    return st.lists(edit, min_size=1, max_size=1) | st.lists(edit, min_size=1, max_size=4)


def value_edits() -> st.SearchStrategy:
    """Return lists of one or two edits of a JSON value."""
    path = st.lists(st.integers(0, 40), max_size=6).map(tuple)
    return st.lists(st.builds(Replacement, path, VALUES), min_size=1, max_size=2)


def drawn(strategy: st.SearchStrategy, count: int, seed: int) -> list[Any]:
    """Return about `count` values of a strategy, the same for the same seed."""
    found: list[Any] = []

    @hypothesis.seed(seed)
    @settings(
        max_examples=count,
        database=None,
        deadline=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(strategy)
    def collect(value: Any) -> None:
        found.append(value)

    collect()
    return found


def spoilt(data: bytes, edits: list, form: Form | None) -> bytes:
    """Return a valid file after all edits."""
    if edits and isinstance(edits[0], Replacement):
        assert form is not None
        value = form.read(data)
        for edit in edits:
            value = edit.apply_to(value)
        return form.write(data, value)
    for edit in edits:
        data = edit.apply(data)
    return data


def fewest(edits: list, fails: Callable[[list], bool]) -> list:
    """Return the edits without those that a failure does not need."""
    for edit in list(edits):
        fewer = [other for other in edits if other is not edit]
        if fewer and fails(fewer):
            edits = fewer
    return edits


def with_checksums(data: bytes) -> bytes:
    """Return a PNG file whose chunks have sound checksums, so that a decoder looks at what is in them."""
    made, place = bytearray(data[:8]), 8
    with contextlib.suppress(struct.error):
        while place + 12 <= len(data):
            length = struct.unpack(">I", data[place : place + 4])[0]
            body = data[place + 4 : place + 8 + length]
            made += data[place : place + 4] + body + struct.pack(">I", zlib.crc32(body))
            place += 12 + length
    return bytes(made)


def _json(value: Any) -> bytes:
    return json.dumps(value).encode()


def _tokens(data: bytes, value: Any) -> bytes:
    words = value if isinstance(value, list) else [value]
    return " ".join(word if isinstance(word, str) else str(word) for word in words).encode(
        errors="surrogatepass"
    )


def _glb(data: bytes, value: Any) -> bytes:
    old = struct.unpack_from("<I", data, 12)[0]
    text = _json(value)
    text += b" " * (-len(text) % 4)
    rest = data[20 + old :]
    head = struct.pack("<4sII", b"glTF", 2, 20 + len(text) + len(rest))
    return head + struct.pack("<I4s", len(text), b"JSON") + text + rest


def _safetensors(data: bytes, value: Any) -> bytes:
    text = _json(value)
    return struct.pack("<Q", len(text)) + text + data[8 + struct.unpack_from("<Q", data)[0] :]


JSON = Form(json.loads, lambda data, value: _json(value))
WORDS = Form(lambda data: data.decode().split(" "), _tokens)
GLB = Form(lambda data: json.loads(data[20 : 20 + struct.unpack_from("<I", data, 12)[0]]), _glb)
SAFETENSORS = Form(lambda data: json.loads(data[8 : 8 + struct.unpack_from("<Q", data)[0]]), _safetensors)
LINES = Form(
    lambda data: [json.loads(line) for line in data.splitlines()],
    lambda data, value: b"".join(
        _json(line) + b"\n" for line in (value if isinstance(value, list) else [value])
    ),
)
