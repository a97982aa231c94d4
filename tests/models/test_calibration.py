import json

import pytest
import torch

from lightprobe.core.errors import InputError
from lightprobe.models.calibration import Calibration
from tests.lit_sphere import glossy_sphere


def test_files_give_it_back(tmp_path):
    calibration = Calibration((1.5, 1.25, 0.5), "a grey card")
    calibration.save(tmp_path / "c.json")
    assert Calibration.load(tmp_path / "c.json") == calibration
    assert Calibration.load(tmp_path / "none.json") is None


@pytest.mark.parametrize(
    "value",
    [
        [],
        {},
        {"light_factor_rgb": [1, 2], "source": "x"},
        {"light_factor_rgb": [1, 2, "3"], "source": "x"},
        {"light_factor_rgb": [1, 2, 1000], "source": "x"},
        {"light_factor_rgb": [1, 2, 0], "source": "x"},
        {"light_factor_rgb": [1, 1, True], "source": "x"},
        {"light_factor_rgb": [1, 1, 1]},
        {"light_factor_rgb": [1, 1, 10**400], "source": "x"},
        {"light_factor_rgb": [1, 1, float("nan")], "source": "x"},
    ],
)
def test_a_damaged_file_is_told_with_its_remedy(tmp_path, value):
    (tmp_path / "c.json").write_text(json.dumps(value))
    with pytest.raises(InputError, match=r"c\.json .*--reset"):
        Calibration.load(tmp_path / "c.json")


def test_base_colours_are_divided_and_never_above_one():
    asset = glossy_sphere()
    changed = Calibration((2.0, 1.0, 0.5), "x").applied(asset).textures.base_color
    color = asset.textures.base_color
    torch.testing.assert_close(changed[..., 0], color[..., 0] / 2)
    torch.testing.assert_close(changed[..., 1], color[..., 1])
    torch.testing.assert_close(changed[..., 2], (2 * color[..., 2]).clamp(max=1))
