"""The stages of a prediction, and how their cost grows with pixels, texels and triangles."""

import functools
from collections.abc import Callable

import numpy as np
import torch

from lightprobe.light import prefilter
from lightprobe.models import Decomposition
from lightprobe.prediction import Method, PredictConfig, Predictor
from lightprobe.prediction.confidence import confidence
from lightprobe.prediction.observation import observe
from lightprobe.prediction.prior import constant_light
from lightprobe.prediction.solve import solve_environment
from lightprobe.render.asset import Asset, rasterize_asset
from lightprobe.render.picture import Picture
from lightprobe.render.transport import Transport
from lightprobe.scene.camera import Similarity
from speed.ball import COVERED, CPU, ball, camera, light, photograph
from speed.clock import seconds
from speed.growth import Cases, growth_rows


@torch.no_grad()
def stages(asset: Asset, side: int, texels: int, repeats: int) -> dict[str, float]:
    """Return the seconds of every stage of a prediction, and of the whole."""
    view = camera(side)
    env, operator = light(texels), prefilter.cached(texels, CPU)
    photo = photograph(asset, view, env)
    predictor = Predictor(
        Decomposition(asset, {}, Similarity(np.zeros(3), 1.0)), config=PredictConfig(light_resolution=texels)
    )
    observation = observe(asset, photo, view, CPU, predictor.config.max_pixels)
    prior = constant_light(observation, texels)
    transport = Transport(observation.gbuffer, operator, observation.rows)
    radiance = transport.apply(env)
    picture = Picture.of(asset, view, operator, CPU)
    works: dict[str, Callable[[], object]] = {
        "rasterise": lambda: rasterize_asset(asset, view, CPU),
        "make a picture ready": lambda: Picture.of(asset, view, operator, CPU),
        "light it": lambda: picture.render(env),
        "prefilter": lambda: operator.apply(env),
        "build transport": lambda: Transport(observation.gbuffer, operator, observation.rows),
        "apply transport": lambda: transport.apply(env),
        "its adjoint": lambda: transport.adjoint(radiance),
        "solve": lambda: solve_environment(observation, prior, predictor.solve_config, 0),
        "confidence": lambda: confidence(observation, env, fitted=True, seed=0),
        "prediction (solve)": lambda: predictor.predict(photo, view, Method.SOLVE),
    }
    return {name: seconds(work, repeats) for name, work in works.items()}


def stage_tables(repeats: int, *, quick: bool) -> list[str]:
    """Return the three tables of growth; where a size is not varied it is the usual one."""
    side, texels, levels = (128, 16, 3) if quick else (320, 32, 5)
    sides = (64, 128) if quick else (128, 181, 256, 362, 512)
    lights = (8, 16) if quick else (16, 32, 64)
    balls = (2, 3) if quick else (3, 4, 5, 6)
    made = functools.cache(ball)
    pixels: Cases = {COVERED * s**2: stages(made(levels), s, texels, repeats) for s in sides}
    lit: Cases = {6.0 * r * r: stages(made(levels), side, r, repeats) for r in lights}
    faces: Cases = {20.0 * 4**n: stages(made(n), side, texels, repeats) for n in balls}
    return [
        f"Milliseconds; a ball of {20 * 4**levels:,} triangles, a photo of {side} x {side} and a light of",
        f"6 x {texels} x {texels} where not varied. A prediction reduces photos to 65 536 object pixels and solves",
        "from a fixed number of them, so its cost stops growing.",
        "",
        *growth_rows("object pixels", pixels),
        "",
        *growth_rows("texels of the light", lit),
        "",
        *growth_rows("triangles", faces),
    ]
