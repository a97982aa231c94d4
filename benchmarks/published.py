"""Numbers that others have published, as far as ours can stand beside them. PSNR in dB."""

from dataclasses import dataclass

from lightprobe.evaluation.three_spheres import SPHERES


@dataclass(frozen=True)
class PublishedLight:
    """Three-sphere si-RMSE (diffuse, matte, mirror) of somebody else's method, and how its protocol differs."""

    name: str
    si_rmse: tuple[float, float, float]
    difference: str

    @property
    def scores(self) -> dict[str, float]:
        """Return the errors by the names of our scores."""
        return {f"{sphere}_si_rmse": value for sphere, value in zip(SPHERES, self.si_rmse, strict=True)}


PUBLISHED_LIGHTS = (
    PublishedLight(
        "LuxDiT", (0.077, 0.196, 0.442), "Poly Haven panoramas, from a photo of the place, no known object"
    ),
    PublishedLight(
        "NeuS + Mitsuba", (0.082, 0.232, 0.424), "real objects under real light, from photos of the object"
    ),
    PublishedLight("DiffusionLight", (0.113, 0.270, 0.519), "from a photo of the place, no known object"),
)

Scores = tuple[str, str]  # PSNR and SSIM as printed


@dataclass(frozen=True)
class PaperTable:
    """One of the paper's tables of images: PSNR and SSIM of methods on scenes, as printed."""

    number: int
    title: str
    scenes: dict[str, str]  # name in the paper -> name of the scene's folder
    rows: dict[str, tuple[Scores | None, ...]]  # method -> the average, then every scene


PAPER_OURS = "the paper's"  # the row that the paper calls "Ours"

PAPER_TABLES = (
    PaperTable(
        1,
        "NeRD's synthetic scenes, varying light",
        {"Car": "nerd-car", "Chair": "nerd-chair", "Globe": "nerd-globe"},
        {
            "NeRF": (("21.05", ".89"), None, None, None),
            "NeRD": (("27.96", ".95"), None, None, None),
            "Neural-PIL, as published": (("29.24", ".96"), None, None, None),
            "Neural-PIL, reproduced": (
                ("26.33", ".88"),
                ("27.74", ".92"),
                ("29.51", ".92"),
                ("21.95", ".81"),
            ),
            PAPER_OURS: (("27.51", ".94"), ("29.09", ".96"), ("29.61", ".95"), ("23.83", ".90")),
        },
    ),
    PaperTable(
        2,
        "NeRD's real scenes, varying light",
        {"Gnome": "nerd-gnome", "MotherChild": "nerd-motherchild"},
        {
            "NeRF": (("20.11", ".87"), None, None),
            "NeRD": (("25.81", ".95"), None, None),
            "Neural-PIL, as published": (("26.23", ".95"), None, None),
            "Neural-PIL, reproduced": (("22.92", ".87"), ("23.73", ".81"), ("22.11", ".92")),
            PAPER_OURS: (("27.48", ".94"), ("25.25", ".90"), ("29.67", ".97")),
        },
    ),
    PaperTable(
        3,
        "NeRD's real scenes, fixed or nearly fixed light",
        {"Head": "nerd-head", "Cape": "cape"},
        {
            "NeRF": (("23.34", ".85"), None, None),
            "NeRD": (("23.86", ".88"), None, None),
            "Neural-PIL, as published": (("23.95", ".90"), None, None),
            "Neural-PIL, reproduced": (("22.18", ".78"), ("23.14", ".85"), ("21.21", ".71")),
            PAPER_OURS: (("24.00", ".87"), ("24.01", ".89"), ("23.98", ".85")),
        },
    ),
)

# Table 4: seconds to estimate the light of one image, and steps of inference
PAPER_SECONDS = {"NeRD": ("about 3600", "1000"), "Neural-PIL": ("about 300", "100"), PAPER_OURS: ("< 1", "1")}

# Table 5: losses of Phase II on NeRD's Chair, by our names for them
PAPER_LOSSES: dict[str, Scores] = {
    "L2": ("28.68", ".95"),
    "L2, intensity weight": ("28.71", ".95"),
    "L2, sample weight": ("29.24", ".95"),
    "L2, both weights": ("29.61", ".95"),
}


def paper_scores(folder: str) -> Scores | None:
    """Return what the paper's method comes to on the scene of that folder name, or None."""
    for table in PAPER_TABLES:
        if folder in table.scenes.values():
            return table.rows[PAPER_OURS][1 + list(table.scenes.values()).index(folder)]
    return None
