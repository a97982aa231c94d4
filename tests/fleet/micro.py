"""Settings that train a scene in a few steps: what a fleet does with it does not depend on how good it gets."""

from lightprobe.core.config import DecomposeConfig, DistillConfig
from lightprobe.core.config.prediction import PredictConfig
from lightprobe.fleet.training_task import SceneOptions

OPTIONS = SceneOptions(
    DecomposeConfig(
        pass1_iterations=4, pass2_iterations=2, pass3_iterations=2, pass1_side=32, pass2_side=32,
        pass3_texture_size=96, lattice_cells=12, hull_voxels=24, hash_levels=4, hash_finest=32, light_resolution=8,
        teacher_resolution=8, texture_size=64, light_solve_pixels=256, checkpoint_every=2, trial_steps=0,
        light_solve_iterations=2, unwrap_seconds=3600,  # a busy machine changes no bit
    ),
    DistillConfig(
        steps=4, samples=32, light_resolution=8, width=8, checkpoint_every=2, sphere_steps=0, synthetic_lessons=1,
        pretrained=False,
    ),
    PredictConfig(light_resolution=8),
)  # fmt: skip
