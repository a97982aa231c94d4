"""The names of the package itself, in whatever order parts of it were imported before."""

import importlib
import pkgutil
import subprocess
import sys

import pytest

import lightprobe


def python(code: str) -> None:
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert result.returncode == 0, result.stderr


def test_importing_the_package_loads_nothing_heavy():
    python("import sys, lightprobe; assert not {'torch', 'numba', 'numpy'} & set(sys.modules)")


@pytest.mark.slow
def test_predict_loads_none_of_the_evaluation_s_libraries():
    """They take a second to import, more than the prediction."""
    python(
        "import sys, lightprobe.cli.predicting\n"
        "heavy = {'trimesh', 'torchmetrics', 'scipy.stats', 'scipy.ndimage', 'torch._dynamo'}\n"
        "assert not heavy & set(sys.modules), heavy & set(sys.modules)"
    )


def slow(first: str):
    return pytest.param(first, marks=pytest.mark.slow)


@pytest.mark.slow
@pytest.mark.parametrize(
    "first", ["", slow("import lightprobe.evaluation"), slow("from lightprobe.models import ProbeModel")]
)
def test_the_face_of_the_package_is_functions(first):
    python(
        f"{first}\n"
        "import lightprobe\n"
        "from lightprobe import Predictor, decompose, distill, evaluate, load_scene, relight\n"
        "assert all(callable(getattr(lightprobe, name)) for name in lightprobe.__all__)\n"
        "assert set(lightprobe.__all__) <= set(dir(lightprobe))\n"
        "try: lightprobe.decompose()\n"
        "except TypeError as error: assert 'scene' in str(error)\n"
        "else: raise SystemExit('decompose() needs a scene')"
    )


def test_every_name_of_a_package_is_there():
    packages = [lightprobe, *pkgutil.iter_modules(lightprobe.__path__, "lightprobe.")]
    for package in packages:
        module = package if package is lightprobe else importlib.import_module(package.name)
        for name in getattr(module, "__all__", ()):
            assert hasattr(module, name), f"{module.__name__}.{name}"


def test_unknown_names_are_refused():
    python(
        "import lightprobe\n"
        "try: lightprobe.nothing\n"
        "except AttributeError as error: assert 'nothing' in str(error)\n"
        "else: raise SystemExit('no error')"
    )
