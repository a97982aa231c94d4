"""Phase I configuration and its presets.

What no preset changes and docs/paper-preset.md does not discuss is a constant beside its use.
"""

from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any

from lightprobe.core.config.stored import check_values, config_from_json
from lightprobe.core.errors import ConfigError

# least value -> the fields of `DecomposeConfig` that need at least as much
_LEAST = {
    0: "pass2_iterations pass3_iterations surface_smoothing trial_steps validation_photos warm_up_steps",
    1: "pass1_iterations pass1_side pass2_side pass3_side max_faces checkpoint_every light_solve_pixels "
    "hash_levels hash_log2_size hash_coarsest hash_finest",
    2: "texture_size pass3_texture_size",
    8: "lattice_cells hull_voxels",
}


class SdfMode(StrEnum):
    """How the signed distance is held: one free value per lattice vertex, or an MLP of position (the paper)."""

    DIRECT = "direct"
    MLP = "mlp"


class StartShape(StrEnum):
    """What the first pass starts from: the masks' visual hull, a ball, or noise (nvdiffrec; not for an MLP)."""

    HULL = "hull"
    SPHERE = "sphere"
    RANDOM = "random"


class ImageLoss(StrEnum):
    """How a rendered photo is compared.

    `object`: tone-mapped, absolute, over the object's area, no penalty for more light than a clipped pixel
    shows. `log-l1`: tone-mapped, absolute, over the frame, within the photo's mask (nvdiffrec). `l2`: so, but
    squared linear differences (the words of the paper).
    """

    OBJECT = "object"
    LOG_L1 = "log-l1"
    L2 = "l2"


class Smoothed(StrEnum):
    """Which channels are held smooth: the whole material, or base colour (nvdiffrec)."""

    MATERIAL = "material"
    BASE_COLOR = "base-color"


class VertexUnit(StrEnum):
    """In what the second pass measures how vertices move: mean edges of the mesh, or the object's radius."""

    EDGE = "edge"
    RADIUS = "radius"


class LightUpdate(StrEnum):
    """How a photo's light follows the asset: least squares at each visit, or gradient steps (the paper)."""

    SOLVE = "solve"
    GRADIENT = "gradient"


@dataclass(frozen=True)
class DecomposeConfig:
    """Phase I: reconstruct mesh, materials and one environment per training photo."""

    pass1_iterations: int = 1500
    """Optimisation steps on the lattice and the material field."""
    pass2_iterations: int = 800
    """Optimisation steps on vertices and textures; 0 keeps the result of the first pass."""
    pass3_iterations: int = 1500
    """Optimisation steps on the textures alone, for photos larger than `pass2_side`; 0: none."""
    pass1_side: int = 200
    """Longer side in pixels of the photos in the first pass; larger photos are reduced by area averaging."""
    pass2_side: int = 400
    """Longer side of the photos in the second pass."""
    pass3_side: int = 800
    """Longer side of the photos in the third pass."""
    lattice_cells: int = 96
    """Cells along each edge of the tetrahedral lattice."""
    start: StartShape = StartShape.HULL
    """What the first pass starts from; all but the hull take the lattice of the whole box."""
    hull_voxels: int = 128
    """Voxels along each edge of the visual hull the surface starts from."""
    sdf: SdfMode = SdfMode.DIRECT
    """Representation of the signed distance."""
    hash_levels: int = 8
    """Levels of the material's hash grid."""
    hash_log2_size: int = 15
    """Entries per level, as a power of two."""
    hash_coarsest: int = 12
    """Cells of the coarsest level along each edge."""
    hash_finest: int = 256
    """Cells of the finest level along each edge."""
    light_resolution: int = 16
    """Texels along each cubemap edge of the per-photo environments while fitting."""
    teacher_resolution: int = 32
    """Texels along each cubemap edge of the environments that are kept at the end."""
    light_update: LightUpdate = LightUpdate.SOLVE
    """How lights are fitted."""
    light_solve_pixels: int = 3072
    """Pixels a light solve looks at."""
    light_chroma: float = 0.1
    """Pull of a solved light towards its mean colour: lights differ more in brightness than in colour."""
    shadows: bool = True
    """Whether the object may shade itself. Shadows follow the shape at every checkpoint."""
    learning_rate_finish: float = 0.002
    """Adam step of roughness, metallic and normal map in the second pass, which only refines them."""
    warm_up_steps: int = 0
    """Steps over which the rates of the second pass rise from nothing."""
    adam_decay: float = 0.99
    """Decay of Adam's mean of squared gradients, its second beta."""
    image_loss: ImageLoss = ImageLoss.OBJECT
    """How rendered photos are compared in the first two passes."""
    sdf_regularisation: float = 0.2
    """Sign-change cross-entropy weight at the start; it falls to a twentieth over the first quarter."""
    smoothed: Smoothed = Smoothed.MATERIAL
    """Which channels are held smooth; base colour alone is compared beside visible points in both passes."""
    smoothness_texture: float = 0.1
    """Weight of the texture's difference between neighbouring texels in the second pass."""
    metallic_prior: float = 0.015
    """Pull of metallic towards dielectric: a mirror under a free light can imitate any shading."""
    priors: bool = True
    """Whether the material is held to what is usual: its roughness, its brightness, which the first
    checkpoints and trials choose, metals of few colours, and base colours under lights that are grey in the
    mean."""
    trial_steps: int = 240
    """Steps of each trial of a new material early in the first pass, from several brightnesses; trials of the
    present material late in the pass, brighter, darker, metal or opened, take half as many. 0: no trials."""
    texture_gradient_from: float = 0.2
    """Share of the first pass after which photos that disagree about a point's colour move the surface, where a
    part looks like a lid over a cavity only once its opening was tried; before, only outline and shading do.
    0: from the start in any case (nvdiffrec); 1: never."""
    normal_prior: float = 5.0
    """Weight of the field's squared normal offset in the first pass; a fifth of it in the second."""
    normal_ramp: float = 0.5
    """Share of the first pass over which the field's normal offset comes in."""
    laplacian_fades: bool = False
    """Whether the price of the Laplacian of vertices' displacements falls to nothing over the second pass."""
    vertex_unit: VertexUnit = VertexUnit.EDGE
    """Unit of vertices' displacements in the second pass, and so of their Adam step and their Laplacian."""
    coverage_weight: float = 4.0
    """Weight of the squared coverage error beside the colour loss."""
    surface_smoothing: int = 5
    """Rounds of smoothing between the first two passes, which take out the lattice's ripples."""
    max_faces: int = 40000
    """The mesh is decimated to at most this many triangles before unwrapping."""
    crease_degrees: float = 40.0
    """Faces that meet at more than this angle share no normal in the second pass; 180: all edges are smooth."""
    texture_size: int = 512
    """Edge of the square textures in texels."""
    pass3_texture_size: int = 1024
    """Edge of the textures from the third pass on."""
    unwrap_seconds: float = 60.0
    """Time limit of the UV unwrapper, after which a simple atlas is used."""
    validation_photos: int = 5
    """Training photos held out to decide whether the second and third pass are kept, and to judge the object
    by. With 0 the passes are kept unseen, and the object is doubtful at best."""
    checkpoint_every: int = 150
    """Steps between checkpoints, and between renewals of the object's shadows."""

    def __post_init__(self) -> None:
        """Refuse values no run could use."""
        check_values(self, "decompose", _LEAST)
        if self.adam_decay >= 1:
            raise ConfigError(f"decompose.adam_decay must be below 1, not {self.adam_decay}.")
        if self.start is StartShape.RANDOM and self.sdf is SdfMode.MLP:
            raise ConfigError(
                "decompose.start random needs decompose.sdf direct: a network cannot hold noise."
            )

    @property
    def depth_map_side(self) -> int:
        """Pixels along each edge of the depth maps that the object's shadows on itself come from; the first
        pass takes half. 512, and eight a cell for a lattice of less than 64 cells, whose faces need no more.
        """
        return min(8 * self.lattice_cells, 512)

    @staticmethod
    def from_json(value: dict[str, Any]) -> "DecomposeConfig":
        """Return the configuration written as JSON."""
        return config_from_json(DecomposeConfig, value, "Phase I configuration")


def quick() -> DecomposeConfig:
    """Minutes on two CPU cores."""
    return DecomposeConfig()


def demo() -> DecomposeConfig:
    """The bundled scene, whose photos are small, within a few minutes on two CPU cores.

    In so few steps brass does not form against the whole prior, nor anew after a trial:
    docs/decisions/brightness-once-more.md.
    """
    return replace(
        quick(),
        pass1_iterations=650,
        pass2_iterations=330,
        lattice_cells=64,
        max_faces=16000,
        metallic_prior=0.01,
        trial_steps=0,
        texture_gradient_from=1.0,
    )


def standard() -> DecomposeConfig:
    """One GPU, about the quality of `paper` in a fraction of its steps."""
    return replace(
        quick(),
        pass1_iterations=5000,
        pass2_iterations=5000,
        pass3_iterations=3000,
        pass1_side=512,
        pass2_side=800,
        pass3_side=1600,
        lattice_cells=128,
        hull_voxels=192,
        hash_levels=12,
        hash_log2_size=18,
        hash_finest=1024,
        light_resolution=32,
        teacher_resolution=128,
        light_solve_pixels=16384,
        max_faces=100_000,
        texture_size=1024,
        pass3_texture_size=2048,
        unwrap_seconds=300.0,
    )


def paper() -> DecomposeConfig:
    """The paper's settings (4.2), and nvdiffrec's where it gives none: docs/paper-preset.md."""
    return replace(
        standard(),
        pass1_iterations=40_000,
        pass2_iterations=40_000,
        pass3_iterations=0,
        pass1_side=512,
        pass2_side=512,
        lattice_cells=64,
        start=StartShape.SPHERE,
        sdf=SdfMode.MLP,
        hash_levels=16,
        hash_log2_size=19,
        hash_coarsest=16,
        hash_finest=4096,
        light_update=LightUpdate.GRADIENT,
        light_resolution=128,
        light_chroma=0.0,
        shadows=False,
        learning_rate_finish=0.005,
        warm_up_steps=100,
        adam_decay=0.999,
        image_loss=ImageLoss.LOG_L1,
        coverage_weight=1.0,
        sdf_regularisation=0.4,
        smoothed=Smoothed.BASE_COLOR,
        smoothness_texture=0.0,
        metallic_prior=0.0,
        priors=False,
        texture_gradient_from=0.0,
        normal_prior=0.0,
        normal_ramp=0.0,
        laplacian_fades=True,
        surface_smoothing=0,
        max_faces=1_000_000,
        crease_degrees=180.0,
        texture_size=2048,
        unwrap_seconds=3600.0,
        validation_photos=0,
        checkpoint_every=1000,
    )


def paper_small() -> DecomposeConfig:
    """The paper's settings at smaller sizes and with a fifth of the steps: docs/paper-preset.md lists what is scaled."""
    return replace(
        paper(),
        pass1_iterations=8000,
        pass2_iterations=8000,
        pass1_side=200,
        pass2_side=200,
        lattice_cells=40,
        hash_log2_size=16,
        hash_finest=1600,
        light_resolution=32,
        texture_size=800,
        unwrap_seconds=600.0,
        checkpoint_every=500,
    )
