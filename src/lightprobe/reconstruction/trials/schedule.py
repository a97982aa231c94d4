"""When the first pass tries changes of the object; see `reconstruction.trials`.

Only the first checkpoints choose a brightness without a trial. Later the materials have grown used to what
was chosen, and a choice follows their errors: a bottle of gilt and leather and a lacquered vase went on
darkening at every checkpoint.
"""

from lightprobe.core.config import DecomposeConfig, SdfMode

CHOICES = 2  # checkpoints that choose a factor on the base colours
_FIRST_TRIAL = 2  # the checkpoint at which the material is fitted anew
_SECOND_TRIAL = 0.7  # share of the first pass before the second trial: the rest adapts shape and detail to it


def trials_at(config: DecomposeConfig) -> frozenset[int]:
    """Return the steps of the first pass, checkpoints all, at which changes of the object are tried."""
    if config.trial_steps == 0:
        return frozenset()
    every, end = config.checkpoint_every, config.pass1_iterations
    steps = (_FIRST_TRIAL * every, round(_SECOND_TRIAL * end / every) * every)
    return frozenset(
        step for step in steps if step < end
    )  # what comes after the last step is the second pass's


def has_second_trial(config: DecomposeConfig) -> bool:
    """Return whether the first pass is long enough, and set up, for its second trial."""
    return config.priors and len(trials_at(config)) > 1


def lids_tried(config: DecomposeConfig) -> bool:
    """Return whether the second trial opens lids; a network of distances cannot be opened."""
    return has_second_trial(config) and config.sdf is SdfMode.DIRECT


def metals_tried(config: DecomposeConfig, step: int) -> bool:
    """Return whether by a step of Phase I the second trial has decided what is metal.

    With fewer photos than `evidence.FEWEST_PHOTOS` it decides nothing, and what is no metal stays none.
    """
    return has_second_trial(config) and step >= max(trials_at(config))


def refit_steps(config: DecomposeConfig) -> int:
    """Return for how many steps the present material, changed or not, is fitted in a trial."""
    return (config.trial_steps + 1) // 2
