"""What every score is called, how it is written and which way is better: one name for console and report.

PSNR is in dB. "Raw" means as predicted; "scaled" means after one factor per colour channel where a name says
no more, which takes out what light and object can hand to each other (and, for maps, after one factor).
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class Heading:
    """A score's name for people."""

    name: str
    decimals: int
    note: str  # what it says, with its unit
    more_is_better: bool | None = None  # None: neither way

    @property
    def arrow(self) -> str:
        """The way to better values, or nothing."""
        return {True: "↑", False: "↓", None: ""}[self.more_is_better]

    def text(self, value: float) -> str:
        """Return a value as tables show it."""
        return f"{value:.{self.decimals}f}"

    def signed(self, value: float) -> str:
        """Return a difference as tables show it."""
        return f"{value:+.{self.decimals}f}"


Headings = dict[str, Heading]  # key in metrics.json -> heading

IMAGES: Headings = {
    "psnr": Heading("PSNR", 2, "dB; the photo against its re-rendering, full frame on white, sRGB", True),
    "ssim": Heading("SSIM", 3, "structural similarity of the same, 1 at best", True),
    "psnr_masked": Heading("PSNR object", 2, "dB; the object's pixels only", True),
    "ssim_masked": Heading("SSIM object", 3, "the object's pixels only", True),
    "psnr_unseen": Heading(
        "PSNR unseen",
        2,
        "dB; the light from one half of the object's pixels, scored on the other half only",
        True,
    ),
    "seconds": Heading("seconds", 2, "time to predict the light of one photo", False),
}
_SPHERE = "under the predicted and the true light, which are tone-mapped first"
LIGHTS: Headings = {
    "relit_psnr": Heading(
        "relit PSNR raw", 2, "dB; the object in other views under the predicted against the true light", True
    ),
    "relit_psnr_scaled": Heading(
        "relit PSNR scaled", 2, "dB; the same after one factor per colour channel", True
    ),
    "diffuse_si_rmse": Heading("diffuse", 3, f"scale-invariant RMSE of a diffuse sphere {_SPHERE}", False),
    "matte_si_rmse": Heading("matte", 3, "the same for a rough reflecting sphere", False),
    "mirror_si_rmse": Heading("mirror", 3, "the same for a mirror sphere", False),
    "diffuse_angular": Heading(
        "diffuse °", 1, "mean angle in degrees between the colours of that sphere", False
    ),
    "matte_angular": Heading("matte °", 1, "the same for the rough reflecting sphere", False),
    "mirror_angular": Heading("mirror °", 1, "the same for the mirror sphere", False),
}
MAPS: Headings = {
    "light_log_rmse": Heading(
        "log-RMSE raw",
        3,
        "error of ln radiance against the true map, by solid angle; 0.7 is a factor of two",
        False,
    ),
    "light_log_rmse_scaled": Heading("log-RMSE scaled", 3, "the same after one factor", False),
    "light_log_rmse_channels": Heading(
        "log-RMSE per channel", 3, "the same after one factor per channel", False
    ),
    "light_log_rmse_bright": Heading(
        "log-RMSE brightest raw",
        3,
        "the raw one over the brightest percent of the true light's solid angle",
        False,
    ),
    "light_log_rmse_bright_scaled": Heading(
        "log-RMSE brightest scaled", 3, "the same after the one factor of the whole map", False
    ),
    "light_log_rmse_confident": Heading(
        "log-RMSE confident", 3, "the raw one, weighted by the confidence", False
    ),
}
OBJECT: Headings = {
    "chamfer": Heading(
        "Chamfer distance", 4, "mean distance of the surfaces, both ways, in object radii", False
    ),
    "base_color_psnr": Heading("base colour PSNR raw", 2, "dB; of the pixels that both objects cover", True),
    "base_color_psnr_scaled": Heading(
        "base colour PSNR scaled", 2, "dB; after one factor per colour channel", True
    ),
    "base_color_ratio": Heading(
        "base colour over truth",
        2,
        "ratio of the mean linear base colours, geometric mean over channels; 1 at best",
    ),
    "base_color_ratio_worst": Heading(
        "base colour over truth, worst", 2, "the same of the channel that is farthest from 1"
    ),
    "roughness_mae": Heading("roughness error", 3, "mean absolute", False),
    "metallic_mae": Heading("metallic error", 3, "mean absolute", False),
    "normal_degrees": Heading("normal error °", 1, "mean angle in degrees", False),
    "relight_psnr": Heading(
        "relighting PSNR raw", 2, "dB; the object under known novel lights against true renders of it", True
    ),
    "relight_psnr_scaled": Heading(
        "relighting PSNR scaled", 2, "dB; the same after one factor per channel", True
    ),
    "relight_ssim": Heading("relighting SSIM raw", 3, "structural similarity of the same", True),
    "relight_ssim_scaled": Heading(
        "relighting SSIM scaled", 3, "the same after one factor per channel", True
    ),
}
