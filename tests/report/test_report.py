import html.parser
import re

import numpy as np

from lightprobe.report.pictures import PICTURE_HINTS, PICTURE_NOTES, data_uri, object_box
from lightprobe.report.report import Report, evenly_spaced, report_page, write_report

METRICS = {
    "default_method": "solve",
    "mean": {"psnr": 24.5, "psnr_masked": 25.25, "chamfer": 0.0123},
    "methods": {
        "solve": {"psnr": 24.5, "psnr_masked": 25.25, "seconds": 0.4, "light_log_rmse": 0.7},
        "constant": {"psnr": 20.0, "seconds": 0.1, "light_log_rmse": 0.9},
    },
    "photos": {"<cup> & saucer": {"psnr": 24.5, "psnr_masked": 25.25}},
}


class Balance(html.parser.HTMLParser):
    """Fails on a closing tag that does not match, and keeps all addresses."""

    def __init__(self):
        super().__init__()
        self.open, self.addresses, self.places = [], [], set()

    def handle_starttag(self, tag, attributes):
        self.addresses += [value for key, value in attributes if key in ("src", "href")]
        self.places |= {f"#{value}" for key, value in attributes if key == "id"}
        if tag not in ("meta", "img", "br"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def page(tmp_path, *, metrics=METRICS, titles=("photo", "true light"), **more) -> str:
    picture = data_uri(np.random.default_rng(0).random((600, 400, 3)))
    pictures = {name: dict.fromkeys(titles, picture) for name in metrics["photos"]}
    return report_page(Report("A <b>", metrics, pictures, {"photos": "3"}, **more), tmp_path)


def test_page_is_well_formed_and_needs_no_other_file(tmp_path):
    reader = Balance()
    reader.feed(page(tmp_path, titles=tuple(PICTURE_NOTES), commands=["lightprobe eval RUN"]))
    assert reader.open == []
    assert reader.addresses
    outward = set(reader.addresses) - reader.places
    assert all(address.startswith("data:image/jpeg;base64,") for address in outward)


def test_pictures_lead_and_numbers_lead_to_their_photo(tmp_path):
    text = page(tmp_path, titles=tuple(PICTURE_NOTES))
    order = [
        "photo",
        "render",
        "predicted light",
        "spheres, predicted light",
        "true light",
        "spheres, true light",
    ]
    assert re.findall(r'<img alt="([^"]+)"', text)[:6] == order
    assert text.index("<img") < text.index("<table")
    assert '<td><a href="#photo-0">&lt;cup&gt; &amp; saucer</a></td>' in text
    assert '<section id="photo-0"' in text


def test_without_a_true_light_the_confidence_stands_in_its_place(tmp_path):
    text = page(tmp_path, titles=("photo", "predicted light", "confidence", "normal"))
    assert text.index('alt="confidence"') < text.index("<details open")


def test_doubts_and_photos_that_are_not_scored_are_told(tmp_path):
    assert "Verdicts" not in page(tmp_path)
    verdicts = {
        "doubtful": 1,
        "photos": {"<a>": {"sentences": ["The mask is another's."]}, "b": {"sentences": []}},
    }
    text = page(tmp_path, metrics=METRICS | {"verdicts": verdicts, "skipped": {"c": "c.png is gone."}})
    assert "Doubtful: 1 of 2 photos." in text
    assert "<li><b>&lt;a&gt;</b>: The mask is another&#39;s.</li>" in text
    assert "<li><b>c</b>: c.png is gone.</li>" in text


def test_names_are_escaped_and_numbers_shown(tmp_path):
    text = page(tmp_path, commands=["lightprobe <x>"])
    assert "&lt;cup&gt; &amp; saucer" in text
    assert "<cup>" not in text
    assert "A &lt;b&gt;" in text
    assert "lightprobe &lt;x&gt;" in text
    for number in ("24.50", "25.25", "0.0123", "0.40", "20.00"):
        assert number in text


def test_links_lead_from_the_page_to_the_files_that_exist(tmp_path):
    run = tmp_path / "run"
    light, mesh = run / "predictions" / "a+b" / "c d.exr", run / "mesh" / "object.glb"
    for path in (light, mesh):
        path.parent.mkdir(parents=True)
        path.write_text("")
    files = {"light": light, "confidence": light.with_suffix(".confidence.exr")}
    photo_files = {"<cup> & saucer": files}
    text = page(run / "report", files={"object.glb": mesh}, photo_files=photo_files)
    assert '<a href="../mesh/object.glb">object.glb</a>' in text
    assert '<a href="../predictions/a%2Bb/c%20d.exr">light</a>' in text
    assert len(re.findall(r'<a href="[^#]', text)) == 2


def test_headings_say_which_way_is_better_and_the_best_values_are_bold(tmp_path):
    text = page(tmp_path)
    assert re.search(r"<th[^>]*>PSNR <span[^>]*>↑</span></th>", text)
    assert re.search(r"<th[^>]*>log-RMSE raw <span[^>]*>↓</span></th>", text)
    for number, best in (("24.50", True), ("20.00", False), ("0.40", False), ("0.10", True), ("0.700", True)):
        assert (f"><b>{number}</b></td>" in text) is best
    assert "<b>25.25</b>" not in text  # of one method only: nothing to be better than


def test_columns_and_pictures_are_explained_where_no_pointer_must_hover(tmp_path):
    text = page(tmp_path, titles=("confidence", "difference ×3"))
    assert "<dt>PSNR ↑</dt><dd>dB; the photo against its re-rendering" in text
    assert "<dt>confidence</dt><dd>exp(-the error to expect of ln radiance)" in text
    assert "<dt>photo</dt>" not in text  # no such picture on the page
    for hint in PICTURE_HINTS.values():
        assert f"<small>{hint}</small>" in text


def test_confidence_has_a_scale_and_other_pictures_none(tmp_path):
    assert 'class="scale"' not in page(tmp_path)
    text = page(tmp_path, titles=("confidence", "predicted light"))
    assert text.count('class="scale"') == 1
    assert '<span style="left: 50.0%">0.5<br>×2</span>' in text


def test_a_method_that_saw_fewer_photos_says_so_and_is_never_the_best(tmp_path):
    metrics = {
        "default_method": "solve",
        "mean": {},
        "methods": {"solve": {"psnr": 24.5}, "constant": {"psnr": 20.0}, "optimize": {"psnr": 30.0}},
        "interval": {"optimize": {"psnr": 1.25}, "constant": {"psnr": 0.5}},
        "photos": {
            "a": {"methods": {"solve": {}, "constant": {}, "optimize": {}}},
            "b": {"methods": {"solve": {}, "constant": {}}},
        },
    }
    text = page(tmp_path, metrics=metrics)
    assert '<td>optimize (1 photo)</td><td data-value="30">30.00</td>' in text  # few photos carry no interval
    assert '<td>constant</td><td data-value="20">20.00<small> ± 0.50</small></td>' in text
    assert '<td>solve</td><td data-value="24.5"><b>24.50</b></td>' in text


def test_the_run_tells_how_it_was_made(tmp_path):
    text = page(tmp_path, commands=["lightprobe train SCENE -o RUN", "lightprobe eval RUN"])
    assert "photos 3" in text
    assert "lightprobe train SCENE -o RUN\nlightprobe eval RUN" in text
    assert "<code>" not in page(tmp_path)


def test_pictures_are_small(tmp_path):
    noise = np.random.default_rng(1).random((2000, 3000, 3))
    assert len(data_uri(noise)) < 80_000
    write_report(tmp_path / "r" / "index.html", Report("t", METRICS))
    assert (tmp_path / "r" / "index.html").read_text().startswith("<!doctype html>")


def test_pictures_are_cut_to_the_object():
    mask = np.zeros((100, 60), bool)
    mask[20:80, 0:10] = True
    assert mask[object_box(mask)].sum() == mask.sum()
    assert mask[object_box(mask)].shape == (70, 12)
    assert mask[object_box(~mask | mask)].shape == mask.shape


def test_spread_takes_evenly():
    names = [str(i) for i in range(100)]
    assert evenly_spaced(names, 4) == ["0", "25", "50", "75"]
    assert evenly_spaced(names[:3], 4) == names[:3]
