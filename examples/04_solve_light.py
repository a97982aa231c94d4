"""A photo's light without a network: with shape and material known, the photo is a linear map of its light.

    python examples/04_solve_light.py runs/pot src/lightprobe/assets/demo/test/r_000.png -o solved.exr

`observe` finds the object's pixels, `Transport` is the linear map A from a cubemap to their colours, and
`solve_light` finds the light E >= 0 with the least |A E - I|² that stays near a grey one. `--pull` is how
strongly it stays there: what the photo does not pin down is left grey.
"""

import argparse
from pathlib import Path

import torch

import lightprobe
from lightprobe.light import prefilter
from lightprobe.light.environment import Environment
from lightprobe.light.photometry import relative_tone_weight
from lightprobe.prediction.observation import observe
from lightprobe.render.transport import Transport, solve_light

RESOLUTION = 16


def main() -> None:
    """Solve as the command line says."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("run", type=Path)
    parser.add_argument("photo", type=Path)
    parser.add_argument("--camera", type=Path, help="by default that of the run's scene")
    parser.add_argument("--pull", type=float, default=0.003)
    parser.add_argument("-o", "--output", type=Path, default=Path("solved.exr"))
    given = parser.parse_args()

    cpu, known = torch.device("cpu"), lightprobe.Predictor.load(given.run).decomposition
    pixels, camera = lightprobe.load_photo(given.photo, given.camera or given.run / "scene.json")
    seen = observe(known.asset, pixels, camera.normalised(known.similarity), cpu, max_pixels=16384)
    transport = Transport(seen.gbuffer, prefilter.cached(RESOLUTION), seen.rows)
    weight = relative_tone_weight(seen.pixels.color, seen.light_level)
    grey = seen.light_level.expand(6, RESOLUTION, RESOLUTION, 3).contiguous()
    solved = solve_light(
        transport, seen.pixels.color, weight, seen.clipped, grey, regularisation=given.pull, iterations=20
    )

    for name, radiance in (("grey", transport.apply(grey)), ("solved", solved.radiance)):
        error = (radiance - seen.pixels.color).square().mean().sqrt()
        print(f"{name:>6} light: root mean square error of {len(seen.rows)} pixels {error:.4f}, linear")
    Environment(solved.light).save(given.output)
    print(f"wrote {given.output}")


if __name__ == "__main__":
    main()
