"""The light of one photo, how far each direction can be trusted, and whether the photo can be trusted at all.

    python examples/02_predict.py runs/pot src/lightprobe/assets/demo/test/r_000.png -o light.exr

A photo of the run's own scene finds its camera in the run. Another one takes `--camera`: a JSON file as
README describes it, or a transforms file that names the photo.
"""

import argparse
from pathlib import Path

import lightprobe
from lightprobe.light import cubemap


def main() -> None:
    """Predict as the command line says."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("run", type=Path)
    parser.add_argument("photo", type=Path)
    parser.add_argument("--camera", type=Path, help="by default that of the run's scene")
    parser.add_argument("--mask", type=Path, help="white object on black; by default the photo's alpha")
    parser.add_argument("-o", "--output", type=Path, default=Path("light.exr"))
    given = parser.parse_args()

    predictor = lightprobe.Predictor.load(given.run)
    pixels, camera = lightprobe.load_photo(given.photo, given.camera or given.run / "scene.json", given.mask)
    prediction = predictor.predict(pixels, camera)  # raises InputError for a photo that no light explains

    verdict, light = prediction.verdict, prediction.environment
    print(f"photo {verdict.status.value}: light explains {100 * verdict.explained:.0f} % of what it shows")
    for sentence in verdict.sentences:  # none for a good photo
        print(f"  {sentence}")
    brightest = int(light.texels.mean(-1).argmax())
    direction = cubemap.directions(light.resolution).reshape(-1, 3)[brightest]
    print(f"brightest towards x {direction[0]:+.2f}, y {direction[1]:+.2f}, z {direction[2]:+.2f} (z is up)")
    print(f"its confidence {prediction.confidence.flatten()[brightest]:.2f}; .5 is off by a factor of two")
    print(f"mean radiance {light.mean().mean():.3f}, in {prediction.seconds['total']:.2f} s")

    seen = given.output.with_suffix(".confidence.exr")
    prediction.save(given.output, confidence=seen)
    print(f"wrote {given.output} and {seen}")


if __name__ == "__main__":
    main()
