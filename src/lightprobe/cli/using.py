"""render, relight, export: the learnt object in pictures under any light, and in files for other programs."""

from pathlib import Path
from typing import Annotated

from tyro.conf import FlagCreatePairsOff

from lightprobe.cli.answer import say
from lightprobe.cli.options import CameraArg, Device, EnvironmentArg, RunArg, SizeArg, SunArg, option
from lightprobe.cli.progress import Meter
from lightprobe.core.config.export import ColorSpace, Dome, ExportOptions
from lightprobe.core.config.prediction import Sun
from lightprobe.core.config.rendering import RenderConfig, Renderer
from lightprobe.core.errors import ConfigError
from lightprobe.light.upsampling import map_height
from lightprobe.runs.outputs import export_run, relight_run, render_run

_USUAL = RenderConfig()
_RendererArg = Annotated[Renderer, option(metavar="fast|path", help="What makes the pictures.")]
_SamplesArg = Annotated[
    int | None,
    option(metavar="N", help=f"Rays of each pixel that --renderer path traces, by default {_USUAL.samples}."),
]


def render(
    run: RunArg,
    *,
    camera: CameraArg,
    env: EnvironmentArg,
    output: Annotated[
        Path, option(aliases=["-o"], metavar="OUT", help="Picture: .png (sRGB) or .exr (linear).")
    ],
    frame: Annotated[
        str | None, option(metavar="NAME", help="Photo whose camera is meant, of a file with many.")
    ] = None,
    renderer: _RendererArg = Renderer.FAST,
    samples: _SamplesArg = None,
    device: Device = "auto",
) -> None:
    """Render the object under an environment.

    --renderer path traces paths of light: sharp shadows, all that the object reflects onto itself, and some
    seconds a picture. It needs the extra path and an LLVM library.

    Examples:
      lightprobe render runs/cup --camera view.json --env studio.exr -o cup.png
      lightprobe render runs/cup --camera transforms_test.json --frame r_003 --env studio.exr -o cup.png
      lightprobe render runs/cup --camera view.json --env studio.exr --renderer path --samples 1024 -o cup.png
    """
    render_run(run, env, camera, output, frame=frame, device=device, config=_render_config(renderer, samples))
    say(f"Picture: {output}", picture=output)


def _render_config(renderer: Renderer, samples: int | None) -> RenderConfig:
    """Return how pictures are made; raise `ConfigError` for rays of a renderer that traces none."""
    if samples is not None and renderer is not Renderer.PATH:
        raise ConfigError(
            f"--samples {samples} is for --renderer path; the {renderer.value} one traces no rays."
        )
    return RenderConfig(renderer, _USUAL.samples if samples is None else samples)


def relight(
    run: RunArg,
    *,
    env: EnvironmentArg,
    output: Annotated[Path, option(aliases=["-o"], metavar="DIR", help="Folder for the pictures.")],
    frames: Annotated[int, option(help="Pictures of the turntable.")] = 24,
    side: Annotated[int, option(help="Their size in pixels.")] = 512,
    renderer: _RendererArg = Renderer.FAST,
    samples: _SamplesArg = None,
    device: Device = "auto",
) -> None:
    """Render a turntable and the test views under a new environment.

    --renderer path as of `lightprobe render`.

    Examples:
      lightprobe relight runs/cup --env studio.exr -o relit
      lightprobe relight runs/cup --env studio.exr --renderer path -o relit
    """
    with Meter() as meter:
        relight_run(
            run,
            env,
            output,
            frames=frames,
            side=side,
            device=device,
            config=_render_config(renderer, samples),
            on_progress=meter.update,
        )
    say(f"Pictures: {output}", pictures=output)


def export(
    run: RunArg,
    *,
    output: Annotated[Path, option(aliases=["-o"], metavar="DIR", help="Folder for the files.")],
    env: Annotated[
        Path | None,
        option(metavar="ENV.exr", help="A predicted light, or any equirectangular one, to write, too."),
    ] = None,
    sun: SunArg = Sun.SEPARATE,
    size: SizeArg = None,
    color_space: Annotated[
        ColorSpace, option(metavar="srgb|acescg", help="Primaries of the maps in EXR, which name them.")
    ] = ColorSpace.SRGB,
    usd: Annotated[FlagCreatePairsOff[bool], option(help="Also write scene.usdc and scene.usdz.")] = False,
    dome: Annotated[
        Dome, option(metavar="DomeLight|DomeLight_1", help="USD's schema of the light from all around.")
    ] = Dome.TURNED,
    materialx: Annotated[
        FlagCreatePairsOff[bool], option(help="Also write material.mtlx (OpenPBR).")
    ] = False,
    device: Device = "auto",
) -> None:
    """Write mesh.glb, its textures and the training photos' lights as EXR and HDR, for Blender, three.js and
    others.

    With --env also that light as light.exr, light.hdr and light.jpg (Ultra HDR, for web pages), and scene.glb: the
    mesh with the light's suns and lamps (KHR_lights_punctual), which the maps then do not have, and with the map
    (EXT_lights_image_based); --sun inside leaves suns and lamps in the maps. --usd needs the extra usd, --materialx
    the extra materialx.

    Examples:
      lightprobe export runs/cup -o cup_files
      lightprobe export runs/cup -o cup_files --env light.exr --size 1024x512 --usd
      lightprobe export runs/cup -o cup_files --env light.exr --color-space acescg
    """
    height = None if size is None else map_height(size)
    options = ExportOptions(height, color_space, usd, dome, materialx)
    written = export_run(run, output, environment=env, sun=sun, options=options, device=device)
    say(
        f"{len(written)} files in {output}; mesh: {written[0]}", folder=output, mesh=written[0], files=written
    )
