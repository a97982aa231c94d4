"""The frames in which the stacking bodies evaluate a lobe.

Each pixel gets a frame (t, b, n). With w in that frame and s = n.w + n.v, k = (t.w + t.v)^2 + (b.w + b.v)^2:
|w + v|^2 = k + s^2 and the bracket of D is (k + a2 s^2)/(k + s^2). So D needs 12 fused operations for w, no
square root and one division, and nothing cancels in the core of the lobe.
"""

import torch
from torch import Tensor


def lobe_frames(normals: Tensor, views: Tensor, alpha2: Tensor) -> Tensor:
    """Return (N, 13): t, t.v, b, b.v, n, n.v, a2; the frame after Duff et al. 2017, in float64 to start
    exact.
    """
    n, v = normals.double(), views.double()
    x, y, z = n.unbind(1)
    sign = torch.copysign(torch.ones_like(z), z)
    a = -1 / (sign + z)
    b = x * y * a
    axes = [
        torch.stack([1 + sign * x * x * a, sign * b, -sign * x], 1),
        torch.stack([b, sign + y * y * a, -y], 1),
        n,
    ]
    columns = [part for axis in axes for part in (axis, (axis * v).sum(dim=1, keepdim=True))]
    return torch.cat([*columns, alpha2[:, None].double()], dim=1).float()
