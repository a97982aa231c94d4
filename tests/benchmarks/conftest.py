"""What tests of generated scenes share."""

import pytest

from lightprobe.core.errors import ConfigError
from lightprobe.render.path_tracer import check_path_tracer


@pytest.fixture(scope="session")
def path_tracer():
    """Skip the test where Mitsuba or its LLVM is missing."""
    try:
        check_path_tracer()
    except ConfigError as error:
        pytest.skip(str(error))
