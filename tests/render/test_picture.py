import pytest
import torch

from lightprobe.geometry.mesh import Mesh
from lightprobe.geometry.textures import Textures
from lightprobe.light import prefilter
from lightprobe.render import picture
from lightprobe.render.asset import Asset, textured_visibility
from lightprobe.render.picture import Picture
from tests.shapes import camera_at

CPU = torch.device("cpu")
RED, BLUE = torch.tensor([0.8, 0.1, 0.1]), torch.tensor([0.1, 0.1, 0.8])


def _two_squares(edge: float) -> Asset:
    """Return a blue square of side 2 in the plane x = 0 and, just before it, a red one that ends at `edge`."""
    corners = []
    for x, low, high in ((0.0, -1.0, 1.0), (0.001, -1.0, edge)):
        corners += [(x, low, -1.0), (x, high, -1.0), (x, high, 1.0), (x, low, 1.0)]
    faces = torch.tensor([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]], dtype=torch.int32)
    square = torch.tensor([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    uvs = torch.cat([torch.tensor([0.6, 0.1]) + 0.3 * square, torch.tensor([0.1, 0.1]) + 0.3 * square])
    color = torch.where(torch.arange(32)[None, :, None] < 16, RED, BLUE).expand(32, 32, 3).contiguous()
    plain = torch.tensor([0.0, 0.0, 1.0]).expand(32, 32, 3).contiguous()
    textures = Textures(color, torch.ones(32, 32), torch.zeros(32, 32), plain)
    return Asset(Mesh(torch.tensor(corners), faces, uvs, faces), textures)


def _picture(asset: Asset) -> tuple[torch.Tensor, torch.Tensor]:
    """Return the picture under a white light, one pixel 0.1 wide at the squares, which are 20 x 20 pixels."""
    camera = camera_at((4.0, 0.0, 0.0), size=24, focal=40.0)
    return Picture.of(asset, camera, prefilter.cached(8, CPU), CPU).render(torch.ones(6, 8, 8, 3))


def test_a_pixel_shows_both_surfaces_it_covers():
    even, _ = _picture(_two_squares(0.2))  # ends between two pixels
    mixed, _ = _picture(_two_squares(0.25))  # ends amid one
    red, blue = even[12, 5], even[12, 18]
    assert red[0] > 2 * red[2]
    assert blue[2] > 2 * blue[0]
    torch.testing.assert_close(even[12, 13:15], torch.stack([red, blue]), rtol=0, atol=2e-3)
    torch.testing.assert_close(mixed[12, 14], (red + blue) / 2, rtol=0, atol=2e-3)


def test_coverage_is_the_share_of_the_pixel():
    narrow = _two_squares(0.25)
    faces = narrow.mesh.faces[2:]
    _, cover = _picture(Asset(Mesh(narrow.mesh.vertices, faces, narrow.mesh.uvs, faces), narrow.textures))
    torch.testing.assert_close(cover[12, 2:15], torch.tensor([1.0] * 12 + [0.5]), rtol=0, atol=2e-3)
    assert float(cover.sum()) == pytest.approx(20 * 12.5, rel=1e-3)


def test_one_light_after_the_other_gives_the_pictures_of_each():
    asset, camera = _two_squares(0.25), camera_at((4.0, 1.0, 0.5), size=24)
    operator = prefilter.cached(8, CPU)
    lights = torch.rand(2, 6, 8, 8, 3, generator=torch.Generator().manual_seed(0))
    kept = Picture.of(asset, camera, operator, CPU)
    for light in (*lights, lights[0]):
        fresh = Picture.of(asset, camera, operator, CPU).render(light)
        assert all(torch.equal(one, other) for one, other in zip(kept.render(light), fresh, strict=True))


@pytest.mark.slow
def test_a_large_picture_is_made_in_bands_without_seams(monkeypatch):
    """Outlines run through every band, and a light with a sun casts sharp shadows in all of them."""
    plain = _two_squares(0.25)
    asset = Asset(plain.mesh, plain.textures, textured_visibility(plain.mesh, plain.textures.flat()))
    camera, operator = camera_at((4.0, 1.0, 0.5), size=24, focal=25), prefilter.cached(16, CPU)
    light = torch.full((6, 16, 16, 3), 0.2)
    light[0, 3, 4] = 50.0
    whole = Picture.of(asset, camera, operator, CPU).render(light)
    monkeypatch.setattr(picture, "_WHOLE", 100)
    monkeypatch.setattr(picture, "_BAND", 4 * 24 * 5)  # five rows
    banded = Picture.of(asset, camera, operator, CPU)
    assert len(list(banded.bands([light]))) == 5
    for one, other in zip(whole, banded.render(light), strict=True):
        torch.testing.assert_close(one, other, rtol=0, atol=1e-4)
    assert 0.1 < float(whole[1].mean()) < 0.9


def test_a_pixel_s_colour_is_the_mean_of_four_samples():
    """A red square ends a little beyond a quarter of a pixel: it holds one of the two columns of samples."""
    reds = [_picture(_two_squares(0.2 + 0.1 * share))[0][12, 14, 0] for share in (0.2, 0.3, 0.7, 0.8)]
    blue, red = _picture(_two_squares(0.2))[0][12, 18, 0], _picture(_two_squares(0.2))[0][12, 5, 0]
    found = torch.stack([(each - blue) / (red - blue) for each in reds])
    torch.testing.assert_close(found, torch.tensor([0.0, 0.5, 0.5, 1.0]), rtol=0, atol=0.01)
