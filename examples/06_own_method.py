"""A prediction method of your own, scored beside the program's on the test photos.

    python examples/06_own_method.py runs/pot src/lightprobe/assets/demo

The method here knows two lights only, one from above and one from below, and finds their colours by least
squares. Scores are the photo rendered again, and the error of ln radiance where the scene brings the true
light. CONTRIBUTING.md says what a method needs to become one of `--method`.
"""

import argparse
from collections.abc import Callable
from pathlib import Path

import torch

import lightprobe
from lightprobe.core.config.prediction import Method
from lightprobe.evaluation.metrics import environment_log_rmse, image_scores, log_difference, on_white
from lightprobe.light import cubemap, prefilter
from lightprobe.light.environment import Environment
from lightprobe.prediction.observation import observe
from lightprobe.render.transport import Transport
from lightprobe.scene import load_pixels


def sky_and_ground(known, pixels, camera, resolution: int = 16) -> Environment:
    """Return the light of two halves, above and below, that explains a photo best."""
    seen = observe(
        known.asset, pixels, camera.normalised(known.similarity), torch.device("cpu"), max_pixels=4096
    )
    transport = Transport(seen.gbuffer, prefilter.cached(resolution), seen.rows)
    above = (cubemap.directions(resolution)[..., 2:] > 0).float().expand(-1, -1, -1, 3)
    halves = torch.stack([above, 1 - above])
    renders = torch.stack([transport.apply(half.contiguous()) for half in halves], -1)  # (P, 3, 2)
    fits = [torch.linalg.lstsq(renders[:, c], seen.pixels.color[:, c : c + 1]).solution for c in range(3)]
    return Environment((halves * torch.cat(fits, 1).clamp(min=0)[:, None, None, None]).sum(0))


def main() -> None:
    """Score as the command line says."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("run", type=Path)
    parser.add_argument("scene", type=Path)
    given = parser.parse_args()

    predictor = lightprobe.Predictor.load(given.run)
    known = predictor.decomposition
    methods: dict[str, Callable] = {
        "sky and ground": lambda pixels, camera: sky_and_ground(known, pixels, camera)
    }
    for method in (Method.CONSTANT, Method.SOLVE, Method.PROBE_NET_OPTIMIZE):
        methods[method.value] = lambda seen, view, m=method: (
            predictor.predict(seen, view, m, refuse=False).environment
        )
    for photo in lightprobe.load_scene(given.scene).test:
        pixels, camera = load_pixels(photo)
        color, alpha = torch.from_numpy(pixels.color), torch.from_numpy(pixels.alpha)
        reference = on_white(color * alpha[..., None], alpha)
        for name, predict in methods.items():
            light = predict(pixels, camera)
            score = image_scores(on_white(*lightprobe.relight(known, light, camera)), reference, alpha > 0.5)
            line = f"{photo.name} {name:>18}: {score.psnr_masked:5.2f} dB on the object"
            if photo.truth.environment is not None:
                true = Environment.load(photo.truth.environment, resolution=light.resolution)
                error = environment_log_rmse(log_difference(light.texels, true.texels))
                line += f", light off by {float(error):.2f} in ln radiance"
            print(line)


if __name__ == "__main__":
    main()
