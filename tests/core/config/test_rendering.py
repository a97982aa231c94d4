import pytest

from lightprobe.core.config.rendering import FAST_PICTURES, RenderConfig, Renderer
from lightprobe.core.errors import ConfigError


def test_pictures_are_fast_unless_another_renderer_is_asked_for():
    assert RenderConfig(Renderer.FAST, 256) == FAST_PICTURES


@pytest.mark.parametrize("samples", [0, -1, 65_537])
def test_a_number_of_rays_that_makes_no_picture_is_refused(samples):
    with pytest.raises(ConfigError, match="--samples"):
        RenderConfig(Renderer.PATH, samples)
