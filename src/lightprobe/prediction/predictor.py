"""One photo in, the environment around the object out: the predictors behind one interface.

    photo, camera -> observe (rasterise the asset) -> prior map (constant or learned) -> fit to the photo -> map

Every map is exact in exposure: a photo twice as bright gives a map of twice the radiance. Only the paper's
plain network (`NetworkForm.PLAIN`) does not know that.
"""

import math
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import torch
from torch import Tensor

from lightprobe.core.config.prediction import Method, OptimizeConfig, PredictConfig, SolveConfig, refinement
from lightprobe.core.device import full_precision
from lightprobe.core.errors import ConfigError, InputError
from lightprobe.core.run import REMAKE, RunFolder
from lightprobe.core.stored import damaged
from lightprobe.light.environment import Environment
from lightprobe.models import Decomposition
from lightprobe.models.light_accuracy import LightAccuracy
from lightprobe.models.probe_model import ProbeModel
from lightprobe.prediction.background import BackgroundUse, with_background
from lightprobe.prediction.confidence import confidence
from lightprobe.prediction.observation import Observation, exposed, joined, observe, relative_exposures
from lightprobe.prediction.optimize import optimize_environment, refine_environment
from lightprobe.prediction.prediction import Prediction
from lightprobe.prediction.prior import (
    constant_light,
    desaturated,
    network_light,
    sampled_probes,
    stacked_light,
)
from lightprobe.prediction.solve import solve_environment
from lightprobe.prediction.source_fit import fitted_sources
from lightprobe.prediction.verdict import PhotoStatus, judge_together
from lightprobe.render.seen_light import SeenLight
from lightprobe.scene.background import Background
from lightprobe.scene.camera import Camera
from lightprobe.scene.photo import Pixels


def methods_for(model: ProbeModel | None, config: PredictConfig | None = None) -> tuple[Method, ...]:
    """Return the methods that a run with this model can compare in seconds a photo, the default one first.

    The default is the configured one if there is one and the run has the model for it, else the best.
    """
    possible = [Method.SOLVE, Method.CONSTANT]
    if model is not None:
        possible = [Method.PROBE_MLP_SOLVE, Method.PROBE_MLP, *possible]
        if model.sphere is not None:
            possible = [Method.PROBE_NET_OPTIMIZE, Method.PROBE_NET_SOLVE, Method.PROBE_NET, *possible]
    chosen = None if config is None else config.method
    if chosen is Method.OPTIMIZE or chosen in possible:
        return (chosen, *(method for method in possible if method is not chosen))
    return tuple(possible)


def is_fitted(method: Method) -> bool:
    """Return whether the method's maps are fitted to the photo's pixels, by its last step."""
    return method in _SOLVED or method in _OPTIMIZED


def recorded_config(run: RunFolder) -> PredictConfig:
    """Return the configuration that a run keeps for predictions, the usual one for runs without."""
    if "predict" not in run.sections():
        return PredictConfig()
    try:
        return PredictConfig.from_json(run.config("predict"))
    except ConfigError as error:
        raise damaged(run.config_file, str(error), REMAKE) from error


class Predictor:
    """Predicts light for photos of one object; holds its asset, and the model for the learned methods."""

    def __init__(
        self,
        decomposition: Decomposition,
        model: ProbeModel | None = None,
        device: torch.device | None = None,
        *,
        config: PredictConfig | None = None,
        solve_config: SolveConfig | None = None,
        optimize_config: OptimizeConfig | None = None,
        seed: int = 0,
        accuracy: LightAccuracy | None = None,
    ):
        """Move asset and model to `device` (default: the CPU); the default `config` is the preset `quick`'s.

        accuracy: of the object's maps, which scales the confidence; by default that of a usual object.
        """
        self.device = full_precision(device or torch.device("cpu"))
        self.decomposition = replace(decomposition, asset=decomposition.asset.to(self.device))
        # The networks know the object as it was trained; what they say of it is calibrated at the end.
        trained = decomposition.trained
        self._asset = self.decomposition.asset if trained is None else trained.to(self.device)
        self.model = None if model is None else model.to(self.device)
        self.config = config or PredictConfig()
        self.solve_config = solve_config or SolveConfig()
        self.optimize_config = optimize_config or OptimizeConfig()
        self.refine_config = refinement()
        self.seed = seed
        self.accuracy = accuracy

    @staticmethod
    def load(
        run: Path | str, device: torch.device | None = None, config: PredictConfig | None = None
    ) -> "Predictor":
        """Return the predictor of a run folder, with its model if Phase II has finished there.

        Without `config` it predicts as the run is configured to. Raises `InputError` when `run` is no run
        folder or Phase I has not finished in it.
        """
        folder, where = RunFolder.open(Path(run)), device or torch.device("cpu")
        model = ProbeModel.load(folder.model_folder) if ProbeModel.exists(folder.model_folder) else None
        return Predictor(
            Decomposition.load(folder, where),
            model,
            where,
            config=config or recorded_config(folder),
            accuracy=LightAccuracy.load(folder.model_folder),
        )

    @torch.no_grad()
    def predict(
        self,
        pixels: Pixels,
        camera: Camera,
        method: Method | None = None,
        *,
        background: Background | None = None,
        refuse: bool = True,
        doubt: float = 0.0,
        sources: bool = False,
    ) -> Prediction:
        """Return the light in the photo `pixels` taken by the input-frame `camera`; on a CPU bit for bit.

        method: by default the first of `methods_for`. background: what the photo shows around the object;
        maps that are fitted to the photo follow it. refuse: whether a photo may be refused; an evaluation
        scores all. doubt: an error of ln radiance known beforehand, such as of a doubtful pose, which lowers
        the confidence. sources: whether suns and lamps are found and fitted to the photo, too
        (`prediction.source_fit`).

        Raises `InputError` when the camera does not fit the photo, the object is not in it or the photo's
        verdict is `PhotoStatus.REFUSED`, and `ConfigError` when a learned method is asked for without a
        model.
        """
        clock = _Clock(self.device)
        with clock.part("rasterise"):
            observation = self._observe(pixels, camera, self.config.max_pixels)
            seen = None if background is None else self._seen(background)
        return self._fitted([observation], observation, seen, method, clock, refuse, doubt, sources)

    @torch.no_grad()
    def predict_together(
        self,
        photos: Sequence[tuple[Pixels, Camera]],
        method: Method | None = None,
        *,
        exposures: Sequence[float] | None = None,
        backgrounds: Sequence[Background | None] = (),
        refuse: bool = True,
        doubt: float = 0.0,
        sources: bool = False,
    ) -> tuple[Prediction, Tensor]:
        """Return the one light of all `photos`, in the first one's exposure, and their exposures (N,).

        What the photos tell singly is averaged, and then fitted to all of them together. The exposures are
        relative to the first photo's, and found with the light unless they are given. backgrounds: of each
        photo, None where there is none. The other arguments are those of `predict`. Raises `ConfigError`
        without photos.
        """
        if not photos:
            raise ConfigError("No photo to predict the light from.")
        clock = _Clock(self.device)
        with clock.part("rasterise"):
            share = math.ceil(self.config.max_pixels / len(photos))
            seen = [self._observe(pixels, camera, share) for pixels, camera in photos]
            given = None if exposures is None else torch.tensor(exposures).float()
            found = relative_exposures(seen, self.seed) if given is None else given
            relative = (found / found[0]).to(self.device)
            seen = [exposed(one, exposure) for one, exposure in zip(seen, relative, strict=True)]
            shown = {number: self._seen(part) for number, part in enumerate(backgrounds) if part is not None}
            behind = SeenLight.joined(list(shown.values()), relative[list(shown)]) if shown else None
        return self._fitted(seen, joined(seen), behind, method, clock, refuse, doubt, sources), relative

    def _seen(self, background: Background) -> SeenLight:
        return SeenLight.of(background, self.config.light_resolution, self.device)

    def _observe(self, pixels: Pixels, camera: Camera, max_pixels: int) -> Observation:
        camera = camera.normalised(self.decomposition.similarity)
        return observe(self._asset, pixels, camera, self.device, max_pixels)

    def _fitted(
        self,
        photos: Sequence[Observation],
        joint: Observation,
        seen: SeenLight | None,
        method: Method | None,
        clock: "_Clock",
        refuse: bool,
        doubt: float,
        sources: bool,
    ) -> Prediction:
        """Return the light in `photos` of one light and exposure, together `joint`; see `predict`."""
        method = method or methods_for(self.model, self.config)[0]
        with clock.part("verdict"):
            verdict = judge_together(photos, joint, self.seed)
        if refuse and verdict.status is PhotoStatus.REFUSED:
            raise InputError(" ".join(verdict.sentences))
        light = torch.stack([self._prior(photo, method, clock) for photo in photos]).mean(0)
        if is_fitted(method):
            with clock.part("solve"):
                light = self._fit(joint, light, method, len(photos))
        calibration = self.decomposition.calibration
        with clock.part("confidence"):
            known = self.decomposition.verdict
            doubt = max(verdict.doubt, doubt, 0.0 if known is None else known.doubt)
            trust = confidence(
                joint, light, fitted=is_fitted(method), scale=self._scale(method), doubt=doubt, seed=self.seed
            )
            use = BackgroundUse.ABSENT
            if seen is not None and is_fitted(method):
                # The background is radiance itself; the map is so only after the run's calibration below.
                seen = seen if calibration is None else seen.divided(calibration.tensor(self.device))
                light, trust, use = with_background(joint, light, trust, seen, self.seed)
        environment, split = Environment(light), None
        if sources:
            with clock.part("sources"):
                split = fitted_sources(joint, environment, self._asset.mesh, self.seed)
        if calibration is not None:
            factor = calibration.tensor(self.device)
            environment, split = environment.scaled(factor), None if split is None else split.scaled(factor)
        return Prediction(environment, trust, clock.finish(), verdict, use, split, calibration)

    def _scale(self, method: Method) -> float:
        if self.accuracy is None:
            return 1.0
        return self.accuracy.fitted_scale if is_fitted(method) else self.accuracy.estimated_scale

    def _prior(self, observation: Observation, method: Method, clock: "_Clock") -> Tensor:
        """Return the map that a method begins with."""
        level, resolution = observation.light_level, self.config.light_resolution
        if method in (Method.CONSTANT, Method.SOLVE, Method.OPTIMIZE):
            return constant_light(observation, resolution)
        if self.model is None:
            raise ConfigError(
                "This run has no trained model; run `lightprobe distill` on it, or use --method solve."
            )
        with clock.part("rasterise"):
            chosen = sampled_probes(observation, self.config.sampled_share, self.seed)
        probes = observation.pixels.take(chosen)
        if method in (Method.PROBE_MLP, Method.PROBE_MLP_SOLVE):
            with clock.part("network"):
                colors = self.model.network(probes, level)
            with clock.part("stack"):
                return stacked_light(self.model, colors, probes, level, self.config)
        with clock.part("network"):
            light = network_light(self.model, observation, probes, chosen, resolution, self.seed)
        return light if method is Method.PROBE_NET else desaturated(light, level)

    def _fit(self, observation: Observation, prior: Tensor, method: Method, photos: int) -> Tensor:
        """Return a map fitted to the pixels of so many photos."""
        if method in _SOLVED:
            return solve_environment(observation, prior, self.solve_config, self.seed)
        config = self.optimize_config if method is Method.OPTIMIZE else self.refine_config
        # as many pixels of each photo at every step as one photo alone has
        config = replace(config, pixels=config.pixels * photos, batch=config.batch * photos)
        fit = optimize_environment if method is Method.OPTIMIZE else refine_environment
        return fit(observation, prior, config, self.seed)


_SOLVED = frozenset({Method.SOLVE, Method.PROBE_MLP_SOLVE, Method.PROBE_NET_SOLVE})
_OPTIMIZED = frozenset({Method.OPTIMIZE, Method.PROBE_NET_OPTIMIZE})
_PARTS = ("rasterise", "verdict", "network", "stack", "solve", "confidence")


class _Clock:
    """Wall time of the parts of a prediction."""

    def __init__(self, device: torch.device) -> None:
        self._device, self._begin = device, time.perf_counter()
        self._seconds = dict.fromkeys(_PARTS, 0.0)

    @contextmanager
    def part(self, name: str) -> Iterator[None]:
        begin = time.perf_counter()
        yield
        if self._device.type == "cuda":  # its kernels run on while we go on
            torch.cuda.synchronize(self._device)
        self._seconds[name] = self._seconds.get(name, 0.0) + time.perf_counter() - begin

    def finish(self) -> dict[str, float]:
        return {**self._seconds, "total": time.perf_counter() - self._begin}
