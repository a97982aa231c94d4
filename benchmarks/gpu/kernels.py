"""Every kernel on the device: its time, its share of the device's limit, and its result beside the CPU's."""

import importlib
from collections.abc import Callable

import torch
from torch import Tensor

from benchmarks.gpu.parts import Setting
from benchmarks.speed.ball import CPU
from benchmarks.speed.kernels import Kernel, all_kernels
from benchmarks.speed.timing import Limits, times
from lightprobe.core.device import resolve_device
from lightprobe.kernels import dispatch, sparse_product
from lightprobe.light import prefilter

_CALLS = 10  # between two looks at the clock on a GPU: a call may take less time than the look
TITLES = ("kernel", "ms", "reference, ms", "ratio", "work", "rate", "share of the limit", "off the CPU's")


def kernels_part(setting: Setting) -> None:
    """Write the device's limits and the table of kernels."""
    device = resolve_device(setting.device)
    limits = device_limits(device, brief=setting.brief)
    setting.write(
        "kernels",
        [
            f"Limits measured here: copying {limits.copy / 1e9:.0f} GB/s, read and written bytes both counted; a product",
            f"of float32 matrices, factors unrounded, {limits.arithmetic / 1e9:.0f} GFLOP/s. Tables that fit a cache can",
            "exceed the first, and work is what the formula asks for, once. The last column is the relative L2 difference",
            "from the body that runs on a CPU; of the rasteriser it is the share of pixels that show another face.",
            "",
            f"| {' | '.join(TITLES)} |",
            "| --- |" + " ---: |" * (len(TITLES) - 1),
        ],
    )
    every, same = (all_kernels(quick=setting.brief, device=where) for where in (device, CPU))
    for there, here in zip(every, same, strict=True):
        setting.write("kernels", [kernel_row(there, here, device, limits)])
    setting.write("kernels", [prefilter_row(16 if setting.brief else 32, device, limits)])


def kernel_row(there: Kernel, here: Kernel, device: torch.device, limits: Limits) -> str:
    """Return the row of a kernel whose inputs are on the device; `here` is the same on the CPU."""
    body, plain = (
        importlib.import_module(f"lightprobe.kernels.{name}.{there.module}")
        for name in (dispatch.backend_for(device.type), "reference")
    )
    own = importlib.import_module(f"lightprobe.kernels.numba.{there.module}")
    fast = device_seconds(lambda: there.call(body), device)
    slow = device_seconds(lambda: there.call(plain), device, trials=1, warm_up=device.type == "cuda")
    return _row(there, fast, slow, limits, difference(there.call(body), here.call(own)))


def prefilter_row(resolution: int, device: torch.device, limits: Limits) -> str:
    """Return the row of the product of a prefilter's lobes with a light; a GPU's is PyTorch's own."""
    matrix, own = (prefilter.cached(resolution, where).lobes.forward for where in (device, CPU))
    x = torch.rand(matrix.columns, 3, generator=torch.Generator().manual_seed(0))
    there, entries = x.to(device), len(matrix.value)
    work = entries * (4.0 + matrix.column.element_size()) + 4 * len(matrix.start) + 24 * len(x)
    name = f"prefilter product, 6 x {resolution}², {entries / 1e6:.1f} M entries"
    kernel = Kernel(name, "", lambda _: None, work, False)
    seconds = device_seconds(lambda: sparse_product(matrix, there), device)
    off = difference(sparse_product(matrix, there), sparse_product(own, x))
    return _row(kernel, seconds, None, limits, off)


def _row(kernel: Kernel, fast: float, slow: float | None, limits: Limits, off: float) -> str:
    rate = kernel.work / fast
    unit, limit = ("GFLOP", limits.arithmetic) if kernel.flops else ("GB", limits.copy)
    beside = "– | –" if slow is None else f"{1000 * slow:.2f} | {slow / fast:.1f}"
    share = f"{rate / 1e9:.1f} {unit}/s | {100 * rate / limit:.0f} %"
    return f"| {kernel.name} | {1000 * fast:.3f} | {beside} | {kernel.work / 1e9:.3f} {unit} | {share} | {off:.1e} |"


def difference(found: object, expected: object) -> float:
    """Return the relative L2 difference of the results of two bodies; of integers the share that differs."""
    first, second = (value[0] if isinstance(value, tuple) else value for value in (found, expected))
    if not isinstance(first, Tensor) or not isinstance(second, Tensor):
        raise TypeError("A kernel returns a tensor, or a tuple of them.")
    first = first.cpu()
    if not first.is_floating_point():
        return float((first != second).double().mean())
    return float((first.double() - second.double()).norm() / second.double().norm().clamp(min=1e-30))


def device_seconds(
    work: Callable[[], object], device: torch.device, trials: int = 5, *, warm_up: bool = True
) -> float:
    """Return the median time of a call, several being asked of a GPU before it is waited for."""
    calls = _CALLS if device.type == "cuda" else 1

    def several() -> None:
        for _ in range(calls):
            work()
        if device.type == "cuda":
            torch.cuda.synchronize(device)

    return sorted(times(several, trials, warm_up=warm_up))[trials // 2] / calls


def device_limits(device: torch.device, *, brief: bool) -> Limits:
    """Return the device's rates of copying and of multiplying matrices, each the best of several trials."""
    count, side = (1 << 22, 512) if brief else (1 << 28, 8192)
    source, a = torch.rand(count, device=device), torch.rand(side, side, device=device)
    target = torch.empty_like(source)
    copied = min(device_seconds(lambda: target.copy_(source), device, 1) for _ in range(5))
    product = min(device_seconds(lambda: a @ a, device, 1) for _ in range(5))
    return Limits(2 * 4 * count / copied, 2 * side**3 / product)
