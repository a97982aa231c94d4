import torch

from lightprobe.prediction.prior import desaturated


def test_calming_keeps_brightness_and_a_quarter_of_the_hues():
    warm, cold = torch.tensor([2.0, 1.0, 0.5]), torch.tensor([0.5, 1.0, 2.0])
    light = torch.where(torch.arange(16)[None, :, None, None] < 8, warm, cold).expand(6, 16, 16, 3)
    calm = desaturated(light.contiguous(), torch.tensor(1e-6))
    torch.testing.assert_close(calm.log().mean(-1), light.log().mean(-1), rtol=0, atol=1e-4)
    torch.testing.assert_close(
        (calm[..., 0] / calm[..., 2]).log(), 0.25 * (light[..., 0] / light[..., 2]).log(), rtol=0, atol=1e-3
    )


def test_the_mean_hue_and_darkness_stay():
    tinted = torch.tensor([1.3, 1.0, 0.7]).expand(6, 8, 8, 3).clone()
    torch.testing.assert_close(desaturated(tinted, torch.tensor(1.0)), tinted, rtol=1e-4, atol=1e-5)
    assert desaturated(torch.zeros(6, 8, 8, 3), torch.tensor(1.0)).abs().max() < 1e-6
