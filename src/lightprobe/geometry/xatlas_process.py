"""The UV unwrapper as a process of its own, started by `atlas.unwrap`: a mesh on standard input, charts on
output.

Both are NumPy archives. A process can be stopped when it takes too long, and a crash of native code stays in
it.
"""

import io
import sys

import numpy as np
import xatlas


def unwrap(vertices: np.ndarray, faces: np.ndarray, texture_size: int) -> tuple[np.ndarray, np.ndarray]:
    """Return uvs (U, 2) float32 in [0, 1] and uv_faces (F, 3) int32 of packed charts."""
    atlas = xatlas.Atlas()
    atlas.add_mesh(np.ascontiguousarray(vertices, np.float32), np.ascontiguousarray(faces, np.uint32))
    pack = xatlas.PackOptions()
    pack.resolution = texture_size
    pack.padding = 2
    pack.bilinear = True
    atlas.generate(xatlas.ChartOptions(), pack)
    _, uv_faces, uvs = atlas[0]
    return np.asarray(uvs, np.float32), np.asarray(uv_faces, np.int32)


def main() -> None:
    """Answer one request."""
    request = np.load(io.BytesIO(sys.stdin.buffer.read()), allow_pickle=False)
    uvs, uv_faces = unwrap(request["vertices"], request["faces"], int(request["texture_size"]))
    answer = io.BytesIO()
    np.savez(answer, uvs=uvs, uv_faces=uv_faces)
    sys.stdout.buffer.write(answer.getvalue())


if __name__ == "__main__":
    main()
