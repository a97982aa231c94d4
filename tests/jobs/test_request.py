"""One field of the options is an option, a form field, a column and a part of the JSON."""

import json
from dataclasses import dataclass, fields
from pathlib import Path
from typing import get_type_hints

import pytest
import tyro
from hypothesis import given
from hypothesis import strategies as st

from lightprobe.cli.fleet import fleet_predict
from lightprobe.cli.predicting import predict
from lightprobe.core.config.prediction import Method, Sun
from lightprobe.core.errors import ConfigError
from lightprobe.jobs.request import LightOptions, Output, PredictRequest, field_help, json_schema, parsed
from lightprobe.light.upsampling import HEIGHTS
from lightprobe.service.fields import FIELDS

NAMES = [field.name for field in fields(LightOptions)]
SIZES = st.sampled_from([None, *(f"{2 * rows}x{rows}" for rows in HEIGHTS)])
OPTIONS = st.builds(
    LightOptions,
    method=st.none() | st.sampled_from(Method),
    size=SIZES,
    sources=st.just(True),
    sun=st.sampled_from(Sun),
    background=st.booleans(),
)
REQUESTS = st.builds(
    lambda options, **given: PredictRequest(**vars(options), **given),
    OPTIONS,
    photo=st.just(Path("new.jpg")),
    camera=st.none() | st.just(Path("new.json")),
    name=st.none() | st.text(),
    outputs=st.lists(st.sampled_from(Output), unique=True).map(tuple),
)


@given(REQUESTS)
def test_a_request_is_the_same_after_json(request):
    assert PredictRequest.from_json(json.loads(json.dumps(request.to_json()))) == request


@given(OPTIONS)
def test_options_are_the_same_after_text(options):
    texts = {name: str(value) for name, value in vars(options).items() if value is not None}
    assert LightOptions().updated(texts) == options
    assert options.updated({"method": "", "size": " "}) == options


@pytest.mark.parametrize("name", NAMES)
def test_every_option_is_offered_at_every_door_in_the_same_words(name, capsys):
    words = field_help(LightOptions)[name]
    for command in (predict, fleet_predict):
        with pytest.raises(SystemExit):
            tyro.cli(command, args=["--help"])
        assert f"--{name}" in capsys.readouterr().out
    assert FIELDS[name][1] == words
    assert name in PredictRequest(photo=Path("new.jpg")).to_json()


def test_a_field_more_is_an_option_more():
    """What the doors derive from the fields of the options, of options with another field."""

    @dataclass(frozen=True)
    class More(LightOptions):
        floor: float = 0.5
        """Least radiance."""

    assert More().updated({"floor": "2", "sun": "separate"}) == More(sun=Sun.SEPARATE, floor=2.0)
    assert json_schema(get_type_hints(More)["floor"], 0.5) == {"type": "number", "default": 0.5}
    assert tyro.cli(More, args=["--floor", "3", "--no-sources"]) == More(sources=False, floor=3.0)


@pytest.mark.parametrize(
    ("texts", "words"),
    [
        ({"method": "guess"}, "'method' must be one of constant, "),
        ({"sources": "maybe"}, "'sources' must be true or false"),
        ({"size": "100x100"}, "100x100"),
        ({"sun": "separate", "sources": "no"}, "not looked for"),
    ],
)
def test_values_that_no_prediction_could_use_are_refused(texts, words):
    with pytest.raises(ConfigError, match=words):
        LightOptions().updated(texts)


def test_words_of_a_text_are_the_values_of_a_tuple():
    assert parsed(tuple[Output, ...], "exr, mask exr", "formats") == (Output.EXR, Output.MASK)
    with pytest.raises(ConfigError, match="'formats' must be one of exr"):
        parsed(tuple[Output, ...], "exr,x", "formats")
    with pytest.raises(ConfigError, match="'deadline' must be a number"):
        parsed(float, "soon", "deadline")


def test_the_mask_of_a_photo_comes_out_of_a_folder_by_its_name(tmp_path):
    photo = Path("a/b.jpg")
    assert PredictRequest(photo=photo, mask=tmp_path).mask_file == tmp_path / "b.png"
    assert PredictRequest(photo=photo, mask=Path("m.png")).mask_file == Path("m.png")
