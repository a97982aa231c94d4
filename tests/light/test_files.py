import numpy as np
import pytest
import torch

from lightprobe.core.errors import InputError
from lightprobe.imaging import write_exr, write_radiance
from lightprobe.light.files import load_environments


def test_a_folder_of_maps_is_read_in_the_order_of_names(tmp_path):
    write_exr(tmp_path / "b.exr", np.full((16, 32, 3), 2.0, np.float32))
    write_radiance(tmp_path / "a.hdr", np.full((16, 32, 3), 1.0, np.float32))
    (tmp_path / "README.md").write_text("not a map")
    first, second = load_environments(tmp_path, 16)
    torch.testing.assert_close(first, torch.ones(6, 16, 16, 3), rtol=0.01, atol=0)
    torch.testing.assert_close(second, torch.full((6, 16, 16, 3), 2.0), rtol=0.01, atol=0)


def test_a_folder_without_maps_is_named(tmp_path):
    with pytest.raises(InputError, match=r"has no \.exr or \.hdr"):
        load_environments(tmp_path, 16)
    with pytest.raises(InputError, match="is not a folder"):
        load_environments(tmp_path / "nowhere", 16)
