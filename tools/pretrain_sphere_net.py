"""Train the sphere network that every training of Phase II starts from, on objects that nobody made.

    python tools/pretrain_sphere_net.py      # rewrites src/lightprobe/assets/sphere_net.safetensors, 29 minutes

What turns evidence on the sphere into a light is much the same for all objects: which stacked averages to trust, how
far a blurred lamp is to be sharpened, what a sky looks like where nothing was seen. A training on one object has time
for a few hundred lights; this one sees 17 000, turned and mirrored, on random solids of random materials under the
generated places of `lightprobe.distillation.generated_lights`. No photo and no light of any scene enters.
"""

import argparse
import time
from dataclasses import replace
from itertools import chain
from pathlib import Path

import torch

from lightprobe.core.checkpoint import save_tensors
from lightprobe.core.config.distillation import DistillConfig, quick
from lightprobe.core.device import resolve_device
from lightprobe.distillation.training import train
from lightprobe.training import Progress
from pretraining.photos import lessons_of

TARGET = Path(__file__).parents[1] / "src/lightprobe/assets/sphere_net.safetensors"


def main() -> None:
    """Make the lessons, train, and write the weights."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--solids", type=int, default=360)
    parser.add_argument(
        "--steps", type=int, default=3000, help="of the illumination MLP, whose colours are evidence"
    )
    parser.add_argument("--sphere-steps", type=int, default=20_000)
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--device", default="cpu", help="that trains; lessons are made on the CPU")
    parser.add_argument("--out", type=Path, default=TARGET)
    given = parser.parse_args()
    config = replace(
        quick(),
        steps=given.steps,
        sphere_steps=given.sphere_steps,
        pretrained=False,
    )
    learn(config, given.solids, given.seed, given.out, resolve_device(given.device))


def learn(config: DistillConfig, solids: int, seed: int, out: Path, device: torch.device) -> None:
    """Train on the lessons of the first `solids` solids, and write the sphere network's weights to `out`."""
    began, losses = time.monotonic(), list[float]()

    def tell(words: str) -> None:
        print(f"{words}, {time.monotonic() - began:.0f} s", flush=True)

    def on_step(stage: str, step: int, steps: int, loss: float) -> None:
        losses.append(loss)
        if step % 1000 == 0:
            tell(f"{stage}: step {step} of {steps}, loss {sum(losses[-1000:]) / 1000:.4f}")

    made = chain.from_iterable(lessons_of(number, config, seed) for number in range(solids))
    lessons = [lesson.to(device) for lesson in made]
    tell(f"{len(lessons)} lessons")
    model = train(lessons, config, device, seed, Progress(on_step=on_step))
    if model.sphere is not None:
        save_tensors(out, model.sphere.state_dict())


if __name__ == "__main__":
    main()
