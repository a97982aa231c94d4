import warnings

import pytest

from lightprobe.cli import main
from lightprobe.core.errors import LightprobeWarning


@pytest.mark.parametrize(
    ("kind", "said"), [(LightprobeWarning, "lightprobe: warning: Mind the photo."), (UserWarning, "test_warnings.py")]
)
def test_own_warnings_are_one_sentence_and_others_stay_as_they_are(monkeypatch, capsys, kind, said):
    monkeypatch.setattr(main, "_run", lambda *_: warnings.warn("Mind the photo.", kind, stacklevel=1))
    assert main.main(["inspect", "nowhere"]) == 0
    words = capsys.readouterr().err
    assert said in words
    assert ("\n" not in words.strip()) == (kind is LightprobeWarning)
