"""Its presence puts the repository's root on the path, so that tests can share `tests.shapes` and
`tests.toy_scene`.

The tools are scripts beside the package: their folder is put on the path the way running them does.
Where there is no GPU, Triton's kernels are run by its interpreter, which must be asked for before Triton is
imported. What is skipped for want of anything but a GPU is listed at the end; with
LIGHTPROBE_SKIP_CUDA_ONLY=1 it is a failure.
"""

import os
import sys
from pathlib import Path

import pytest
import torch

sys.path.insert(0, str(Path(__file__).parents[1] / "tools"))
if not torch.cuda.is_available():
    os.environ.setdefault("TRITON_INTERPRET", "1")

# Files of tests that take longest, 20 seconds and more of one core; the longest first
_LONGEST = tuple(
    f"tests/{name}.py"
    for name in (
        "cli/test_resume",
        "reconstruction/test_cavity_trials",
        "cli/test_damaged_run",
        "cli/test_using",
        "evaluation/test_memory",
        "docs/test_docs",
        "examples/test_examples",
        "preparation/test_preparing",
        "reconstruction/test_metal_trials",
        "kernels/test_triton_compiles",
        "benchmarks/test_shoot",
        "tools/test_make_demo_scene",
        "fuzz/test_fuzz",
        "fleet/test_ray_cluster",
        "insertion/test_compositing",
        "localization/test_locator",
        "view/test_page",
        "cli/test_inserting",
        "cli/test_evaluation",
        "runs/test_golden",
        "localization/test_pose_search",
        "scene/test_inspect",
        "render/test_mitsuba_oracle",
        "kernels/test_hash_grid",
        "runs/test_training",
        "cli/test_paper_preset",
    )
)
_FOR_WANT_OF_CUDA = ("CUDA", "Triton runs on the device")
_unexcused: dict[str, int] = {}  # reason -> tests skipped for it


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the longest files: one that came last would run alone, and the other cores would wait for
    it.
    """
    rank = {name: place for place, name in enumerate(_LONGEST)}
    items.sort(key=lambda item: rank.get(item.nodeid.partition("::")[0], len(_LONGEST)))


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Note a test that is skipped."""
    _note(report)


def pytest_collectreport(report: pytest.CollectReport) -> None:
    """Note a file of tests that is skipped as a whole."""
    _note(report)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """List what was skipped for want of a tool."""
    for reason, count in sorted(_unexcused.items()):
        terminalreporter.write_line(f"SKIPPED {count} for want of a tool: {reason}")


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Fail where only a GPU may be missing."""
    if _unexcused and os.environ.get("LIGHTPROBE_SKIP_CUDA_ONLY") == "1" and session.exitstatus == 0:
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


def _note(report: pytest.TestReport | pytest.CollectReport) -> None:
    if not report.skipped or hasattr(report, "wasxfail"):
        return
    reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else str(report.longrepr)
    if not any(words in reason for words in _FOR_WANT_OF_CUDA):
        _unexcused[reason] = _unexcused.get(reason, 0) + 1
