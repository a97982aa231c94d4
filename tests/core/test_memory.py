import numpy as np

from lightprobe.core.memory import peak_memory


def test_the_peak_counts_what_was_held_in_gib_and_never_falls():
    before = peak_memory()
    held = np.ones(3 * 2**27, np.uint8)  # 384 MiB
    grown = peak_memory()
    del held
    assert 0.05 < before < 64
    assert grown >= before
    assert peak_memory() >= max(grown, 0.37)
