"""Phase I configuration.

Every field can be set on the command line; the configuration used is written to the run folder as JSON.
"""

import math
from dataclasses import dataclass, fields, replace
from enum import StrEnum
from typing import Any

from lightprobe.core.config.distillation import LIGHT_RESOLUTIONS
from lightprobe.core.config.stored import config_from_json
from lightprobe.core.errors import ConfigError

# field of `DecomposeConfig` -> the least value that a run can use
_LEAST = {
    **dict.fromkeys(
        ("pass1_iterations", "pass1_side", "pass2_side", "pass3_side", "max_faces", "checkpoint_every"), 1
    ),
    **dict.fromkeys(("hash_levels", "hash_features", "hash_log2_size", "hash_coarsest", "hash_finest"), 1),
    **dict.fromkeys(("light_solve_pixels", "light_solve_iterations"), 1),
    **dict.fromkeys(("texture_size", "pass3_texture_size"), 2),
    **dict.fromkeys(("lattice_cells", "hull_voxels"), 8),
    **dict.fromkeys(
        (
            "pass2_iterations",
            "pass3_iterations",
            "sdf_coarse_grids",
            "surface_smoothing",
            "trial_steps",
            "validation_photos",
            "warm_up_steps",
        ),
        0,
    ),
}


class SdfMode(StrEnum):
    """How the signed distance is held: one free value per lattice vertex, or an MLP of position (the paper)."""

    DIRECT = "direct"
    MLP = "mlp"


class StartShape(StrEnum):
    """What the first pass starts from: the visual hull of the masks, a ball, or noise (nvdiffrec; not for an
    MLP).
    """

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
    """Which channels are held smooth: all of the material, or base colour from step 500 on in full
    (nvdiffrec).
    """

    MATERIAL = "material"
    BASE_COLOR = "base-color"


class VertexUnit(StrEnum):
    """In what the second pass measures how vertices move: mean edges of the mesh, or the object's radius."""

    EDGE = "edge"
    RADIUS = "radius"


class LightUpdate(StrEnum):
    """How a photo's light follows the asset: closed-form least squares at each visit, or gradient steps (the
    paper).
    """

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
    """Optimisation steps on the textures alone, for photos larger than `pass2_side`; 0 keeps the second
    pass's.
    """
    pass1_side: int = 200
    """Longer side in pixels of the photos in the first pass; larger photos are reduced by area averaging."""
    pass2_side: int = 400
    """The same for the second pass."""
    pass3_side: int = 800
    """The same for the third pass."""
    lattice_cells: int = 96
    """Cells along each edge of the tetrahedral lattice."""
    start: StartShape = StartShape.HULL
    """What the first pass starts from; all but the hull take the lattice of the whole box."""
    hull_voxels: int = 128
    """Voxels along each edge of the visual hull the surface starts from."""
    sdf: SdfMode = SdfMode.DIRECT
    """Representation of the signed distance."""
    sdf_coarse_grids: int = 2
    """Coarse grids whose sum is added to direct distances, the finest with a value at every fourth lattice
    cell.
    """
    hash_levels: int = 8
    """Levels of the material's hash grid."""
    hash_features: int = 2
    """Features per level and entry."""
    hash_log2_size: int = 15
    """Entries per level, as a power of two."""
    hash_coarsest: int = 12
    """Cells of the coarsest level along each edge."""
    hash_finest: int = 256
    """Cells of the finest level along each edge."""
    light_resolution: int = 16
    """Texels along each cubemap edge of the per-photo environments while fitting."""
    teacher_resolution: int = 32
    """The same for the environments that are kept at the end."""
    light_update: LightUpdate = LightUpdate.SOLVE
    """How lights are fitted."""
    light_solve_pixels: int = 3072
    """Pixels a light solve looks at."""
    light_solve_iterations: int = 5
    """Iterations of a light solve, warm-started from the previous visit."""
    light_regularisation: float = 0.001
    """Pull of a light towards its own mean in places the photo does not pin down, while the asset changes,
    and of lights that halves of the asset's pixels are compared by."""
    final_light_regularisation: float = 0.003
    """The same for held-out photos and for the lights that are kept."""
    light_chroma: float = 0.1
    """Pull of a solved light's places towards its mean colour: lights differ more in brightness than in
    colour.
    """
    shadows: bool = True
    """Whether the object may shade itself. Shadows follow the shape at every checkpoint."""
    learning_rate_geometry: float = 0.015
    """Adam step of the shape: of lattice distances in cells, of offsets before the tanh that bounds them, of
    vertices in mean edges (or, as in the paper, object radii: `vertex_unit`)."""
    sdf_rate: float = 0.1
    """Adam step of the MLP of distances, relative to that of the geometry."""
    learning_rate_material: float = 0.005
    """Adam step of the material."""
    learning_rate_finish: float = 0.002
    """Adam step of roughness, metallic and normal map in the second pass, which only refines them."""
    learning_rate_texture: float = 0.01
    """Adam step of all textures in the third pass."""
    learning_rate_light: float = 0.005
    """Adam step of the lights (gradient update only)."""
    warm_up_steps: int = 0
    """Steps over which the rates of the second pass rise from nothing."""
    adam_decay: float = 0.99
    """Decay of Adam's mean of squared gradients, its second beta."""
    adam_epsilon: float = 1e-12
    """What Adam adds to the root of that mean."""
    image_loss: ImageLoss = ImageLoss.OBJECT
    """How rendered photos are compared in the first two passes."""
    sdf_regularisation: float = 0.2
    """Sign-change cross-entropy weight at the start; it falls to a twentieth over the first quarter."""
    smoothed: Smoothed = Smoothed.MATERIAL
    """Which channels `smoothness` is about; base colour alone is compared beside visible points in both
    passes.
    """
    smoothness: float = 0.03
    """Weight of the material's change under a small displacement."""
    smoothness_texture: float = 0.1
    """Weight of the texture's difference between neighbouring texels in the second pass."""
    smoothness_detail: float = 0.01
    """The same in the third pass."""
    metallic_prior: float = 0.015
    """Pull of metallic towards dielectric: a mirror under a free light can imitate any shading. Dark metals
    go free.
    """
    roughness_prior: float = 0.03
    """Weight of the squared distance of roughness from a usual one: sharp lobes make the light too free."""
    late_roughness_prior: float = 0.006
    """The same for what is no metal, once it has been tried what is: by then photos tell more about it than
    usage.
    """
    brightness_anchor: float = 0.1
    """Weight of the squared log of the mean base colour over its present one, which the first checkpoints
    choose.
    """
    trial_steps: int = 240
    """Steps for which a new material is fitted from each of several brightnesses, early in the first pass, to
    find out whether the object is a dark one, and twice as many as the present one is for the same late in
    it; 0: neither."""
    parsimony: float = 0.02
    """Weight of the entropy of the metals' base colours. It sets in over the first pass's second quarter; the
    third pass has none."""
    color_gauge: float = 0.02
    """Pull of the base colour to where the mean light over all photos is grey."""
    texture_gradient_from: float = 0.2
    """Share of the first pass after which photos that disagree about a point's colour move the surface;
    before, only outline and shading do. If a part looks like a lid over a cavity, not before it was tried to
    open it. 0: from the start in any case (nvdiffrec); 1: never."""
    normal_prior: float = 5.0
    """Weight of the squared normal offset of the material field in the first pass; a fifth of it in the
    second.
    """
    normal_ramp: float = 0.5
    """Share of the first pass over which the field's normal offset comes in."""
    normal_prior_detail: float = 0.0
    """Weight of the squared tangent part of the normal map in the third pass."""
    light_grey: float = 0.005
    """Weight of the deviation of a light from grey (gradient update only)."""
    laplacian: float = 0.5
    """Weight of the change of the Laplacian against the start mesh in the second pass."""
    laplacian_fades: bool = False
    """Whether that weight falls to nothing over the second pass."""
    vertex_unit: VertexUnit = VertexUnit.EDGE
    """Unit of vertices' displacements in the second pass, and so of their Adam step and their Laplacian."""
    coverage_weight: float = 4.0
    """Weight of the squared coverage error beside the colour loss."""
    surface_smoothing: int = 5
    """Rounds of smoothing between the first two passes, which take out the lattice's ripples and leave longer
    forms.
    """
    max_faces: int = 40000
    """The mesh is decimated to at most this many triangles before unwrapping."""
    crease_degrees: float = 40.0
    """Faces that meet at more than this angle do not share a normal in the second pass; 180 keeps all edges
    smooth.
    """
    texture_size: int = 512
    """Edge of the square textures in texels."""
    pass3_texture_size: int = 1024
    """The same from the third pass on."""
    unwrap_seconds: float = 60.0
    """Time limit of the UV unwrapper, after which a simple atlas is used."""
    validation_photos: int = 5
    """Training photos held out to decide whether the second and third pass are kept, and to judge the object
    by. With 0 the passes are kept unseen, and the object is doubtful at best."""
    checkpoint_every: int = 150
    """Steps between checkpoints, and between renewals of the object's shadows."""

    def __post_init__(self) -> None:
        """Refuse values no run could use."""
        for name, least in _LEAST.items():
            if getattr(self, name) < least:
                raise ConfigError(f"decompose.{name} must be at least {least}, not {getattr(self, name)}.")
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, float) and not 0 <= value < math.inf:
                raise ConfigError(f"decompose.{field.name} must be 0 or more and finite, not {value}.")
        for name in ("light_resolution", "teacher_resolution"):
            if getattr(self, name) not in LIGHT_RESOLUTIONS:
                raise ConfigError(
                    f"decompose.{name} must be a power of two from 8 to 256, not {getattr(self, name)}."
                )

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
    """The paper's settings (section 4.2), and nvdiffrec's published ones where it gives none:
    docs/paper-preset.md.
    """
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
        roughness_prior=0.0,
        late_roughness_prior=0.0,
        brightness_anchor=0.0,
        color_gauge=0.0,
        parsimony=0.0,
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
