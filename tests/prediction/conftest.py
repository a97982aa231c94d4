"""The glossy sphere that photos are taken of."""

import numpy as np
import pytest

from lightprobe.models import Decomposition
from lightprobe.scene.camera import Similarity
from tests.lit_sphere import glossy_sphere


@pytest.fixture(scope="session")
def sphere():
    return glossy_sphere()


@pytest.fixture(scope="session")
def decomposition(sphere):
    return Decomposition(sphere, {}, Similarity(np.zeros(3), 1.0))
