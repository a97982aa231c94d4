import html.parser

import numpy as np

from lightprobe.evaluate.pictures import data_uri, object_box
from lightprobe.evaluate.report import report_page, spread, write_report

METRICS = {
    "default_method": "solve",
    "mean": {"psnr": 24.5, "psnr_masked": 25.25, "chamfer": 0.0123},
    "methods": {"solve": {"psnr": 24.5, "psnr_masked": 25.25, "seconds": 0.4}, "constant": {"psnr": 20.0}},
    "photos": {"<cup> & saucer": {"psnr": 24.5, "psnr_masked": 25.25}},
}


class Balance(html.parser.HTMLParser):
    """Fails on a closing tag that does not match, and keeps all addresses."""

    def __init__(self):
        super().__init__()
        self.open, self.addresses = [], []

    def handle_starttag(self, tag, attributes):
        self.addresses += [value for key, value in attributes if key in ("src", "href")]
        if tag not in ("meta", "img", "br"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def page() -> str:
    picture = data_uri(np.random.default_rng(0).random((600, 400, 3)))
    return report_page(METRICS, {"<cup> & saucer": {"photo": picture, "true light": picture}}, {"photos": "3"}, "A <b>")


def test_page_is_well_formed_and_needs_no_other_file():
    reader = Balance()
    reader.feed(page())
    assert reader.open == []
    assert reader.addresses
    assert all(address.startswith("data:image/jpeg;base64,") for address in reader.addresses)


def test_names_are_escaped_and_numbers_shown():
    text = page()
    assert "&lt;cup&gt; &amp; saucer" in text
    assert "<cup>" not in text
    assert "A &lt;b&gt;" in text
    for number in ("24.50", "25.25", "0.0123", "0.40", "20.00"):
        assert number in text


def test_pictures_are_small(tmp_path):
    noise = np.random.default_rng(1).random((2000, 3000, 3))
    assert len(data_uri(noise)) < 80_000
    write_report(tmp_path / "r" / "index.html", METRICS, {}, {}, "t")
    assert (tmp_path / "r" / "index.html").read_text().startswith("<!doctype html>")


def test_pictures_are_cut_to_the_object():
    mask = np.zeros((100, 60), bool)
    mask[20:80, 0:10] = True
    assert mask[object_box(mask)].sum() == mask.sum()
    assert mask[object_box(mask)].shape == (70, 12)
    assert mask[object_box(~mask | mask)].shape == mask.shape


def test_spread_takes_evenly():
    names = [str(i) for i in range(100)]
    assert spread(names, 4) == ["0", "25", "50", "75"]
    assert spread(names[:3], 4) == names[:3]
