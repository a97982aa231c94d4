"""Records as a benchmark leaves them, with round numbers."""

from typing import Any

from benchmarks.record import Kind, Record
from lightprobe.evaluation.three_spheres import SPHERES

LIGHT = {"relit_psnr": 20.0, "relit_psnr_scaled": 25.0, "light_log_rmse": 1.0, "psnr_unseen": 21.0}


def spheres(value: float) -> dict[str, float]:
    """Return the same error for all three."""
    return {f"{s}_si_rmse": value for s in SPHERES}


def metrics(gain: float = 0.0) -> dict[str, Any]:
    """Return metrics of two photos, the default `net` and the paper's method on both, `slow` on one."""
    default = {"psnr": 30.0, "ssim": 0.9, "psnr_masked": 25.0 + gain, "seconds": 0.9, **LIGHT, **spheres(0.1)}
    default["relit_psnr_scaled"] += gain
    paper = {"psnr": 27.0, "ssim": 0.8, "psnr_masked": 22.0, "seconds": 0.05, **LIGHT, **spheres(0.2)}
    slow = {"psnr_masked": 24.0, "seconds": 90.0}
    parts = [
        {"confidence": 0.1 * i, "log_rmse": 2.0 - 0.1 * i, "log_rmse_scaled": 1.5 - 0.1 * i} for i in range(5)
    ]
    return {
        "mean": {**default, "chamfer": 0.0123, "relight_psnr": 19.0, "base_color_ratio": 0.8},
        "interval": {"net": {"psnr": 1.25}, "slow": {"psnr_masked": 9.0}},
        "default_method": "net",
        "methods": {"net": default, "probe-mlp": paper, "slow": slow},
        "confidence": {
            "net": {"bins": parts, "falls": True},
            "probe-mlp": {"bins": parts[::-1], "falls": False},
            "slow": {"bins": parts, "falls": True},
        },
        "photos": {
            "a": {"light": "sky", "methods": {"net": default, "probe-mlp": paper, "slow": slow}},
            "b": {"light": "sky", "methods": {"net": {**default, "psnr_masked": 99.0}, "probe-mlp": paper}},
        },
    }


def record(scene: str, kind: Kind = Kind.RUN, scored: dict[str, Any] | None = None, **about: Any) -> Record:
    """Return a record of preset quick at commit abc."""
    return Record(scene, kind, scored or metrics(), **{"preset": "quick", "commit": "abc", **about})
