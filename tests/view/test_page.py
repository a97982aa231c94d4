"""The page in a real browser, as a person uses it: everything on it works, and nothing is written to the
console.
"""

import io
import json
import os
import re
import shlex
import shutil
import signal
import time

import numpy as np
import pytest
import torch
import trimesh
from PIL import Image

from lightprobe.evaluation import relight
from lightprobe.imaging import read_mask, srgb_encode, write_exr, write_png
from lightprobe.light.environment import Environment
from lightprobe.models import Decomposition, ObjectVerdict
from lightprobe.scene.record import read_record
from tests.preparation.labelled_scene import BLOCK, labelled_scene, shown_at
from tests.view.browsing import CHROMIUM, PATIENCE, Running, chromium
from tests.view.finished_run import begun_run

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        CHROMIUM is None, reason="there is no chromium; install it with apt-get install chromium"
    ),
]

NETWORK = "Failed to load resource"  # what Chromium itself writes where a server refuses or is gone


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    """A folder as `lightprobe prepare` leaves it, of two photos."""
    folder = tmp_path_factory.mktemp("scene") / "cup"
    picture = np.zeros((60, 80, 3), np.float32)
    picture[15:45, 20:60] = 0.7
    for name in ("a", "b"):
        write_png(folder / "images" / f"{name}.png", picture)
        write_png(folder / "masks" / f"{name}.png", (picture > 0).astype(np.float32), srgb=False)
    report = {
        "mask_stability": {"a": 0.95, "b": 0.6},
        "doubtful_masks": ["b"],
        "warnings": ["Masks are doubtful in 1 of 2 photos."],
    }
    (folder / "prepare.json").write_text(json.dumps(report))
    return folder


@pytest.fixture(scope="module")
def other_scene(scene, tmp_path_factory):
    """Another such folder, in whose path a shell would see two words."""
    return shutil.copytree(scene, tmp_path_factory.mktemp("scene") / "tea pot")


@pytest.fixture(scope="module")
def box_scene(tmp_path_factory):
    """A prepared scene, whose masks can be corrected by clicks, and what is kept of it."""
    pytest.importorskip("cv2")
    folder = tmp_path_factory.mktemp("scene") / "box"
    folder.mkdir()
    return folder, labelled_scene(folder)[0]


@pytest.fixture(scope="module")
def begun(tmp_path_factory):
    """A run whose training has begun."""
    return begun_run(tmp_path_factory.mktemp("begun"))


@pytest.fixture(scope="module")
def server(run, begun, scene, other_scene, box_scene, tmp_path_factory):
    running = Running(
        [run.path, begun.path, scene, other_scene, box_scene[0]], tmp_path_factory.mktemp("session")
    )
    yield running
    running.close()


@pytest.fixture(scope="module")
def browser():
    with chromium() as found:
        yield found


@pytest.fixture
def page(server, browser):
    """A page of its own for each test, which fails if something is written to the console."""
    context = browser.new_context(viewport={"width": 880, "height": 460}, accept_downloads=True)
    opened = context.new_page()
    opened.set_default_timeout(PATIENCE)
    opened.said = []
    opened.on("console", lambda message: opened.said.append(message.text))
    opened.on("pageerror", lambda error: opened.said.append(str(error)))
    yield opened
    context.close()
    assert opened.said == []


def open_object(page, server):
    page.goto(server.url)
    page.wait_for_selector("#stage[data-run='0']")


def drawn(page):
    """Return the stage as numbers, when nothing on it changes any more."""
    before = None
    while True:
        now = np.asarray(Image.open(io.BytesIO(page.locator("#view").screenshot())).convert("RGB"), np.int32)
        if before is not None and np.array_equal(before, now):
            return now
        before = now
        page.wait_for_timeout(30)


def differ(before, after):
    return np.abs(before - after).mean() > 0.2


def test_the_object_is_turned_and_lit_anew(page, server):
    open_object(page, server)
    first = drawn(page)
    page.mouse.move(240, 260)
    page.mouse.down()
    page.mouse.move(330, 240, steps=3)
    page.mouse.up()
    turned = drawn(page)
    assert differ(first, turned)
    page.locator("#view").focus()
    page.keyboard.press("ArrowLeft")
    by_key = drawn(page)
    assert differ(turned, by_key)
    page.select_option("#light", "photo:2")
    other = drawn(page)
    assert differ(by_key, other)
    for control, value in (("#turn", "120"), ("#exposure", "-1.5")):
        page.locator(control).fill(value)
        now = drawn(page)
        assert differ(other, now), control
        other = now
    for control, value in (("#tone", "agx"), ("#background", "blurred")):
        page.select_option(control, value)
        now = drawn(page)
        assert differ(other, now), control
        other = now
    pictures = [other]
    for channel in ("base", "roughness", "metallic", "normal"):
        page.locator(f"input[value={channel}]").check()
        pictures.append(drawn(page))
    assert all(differ(a, b) for i, a in enumerate(pictures) for b in pictures[:i])


def test_the_picture_is_that_of_our_own_render(page, server, run):
    open_object(page, server)
    page.select_option("#stand", "1")
    page.wait_for_selector("#wipe-photo:not([hidden])")
    drawn(page)
    with page.expect_download() as download:
        page.locator("#snapshot").click()
    theirs = np.asarray(Image.open(download.value.path()).convert("RGBA"), np.float32)
    photo = page.locator("#wipe-photo").evaluate("picture => [picture.complete, picture.naturalWidth]")
    assert photo == [True, 40]
    decomposition = Decomposition.load(run, torch.device("cpu"))
    camera = read_record(run).cameras["train"]["train_01"]
    image, cover = relight(decomposition, Environment.load(run.environment_file("train_01")), camera)
    inside = cover.numpy() > 0.999
    ours = 255 * srgb_encode(np.clip(image.numpy()[inside], 0, 1))
    difference = np.abs(theirs[inside][:, :3] - ours)
    assert inside.sum() > 300
    assert theirs[..., 3][inside].min() > 250
    assert difference.mean() < 4  # of 255


def test_light_out_of_a_photo_and_a_thing_into_it(page, server, run, tmp_path):
    photo = run.path.parent / "scene" / "test" / "test_00.png"
    page.goto(f"{server.url}#photo")
    page.set_input_files("#photo-file", photo)
    page.wait_for_selector("#result .verdict")
    assert "own scene" in page.inner_text("#result .verdict")
    for name in ("light.exr", "light.light.json", "confidence.exr", "render.png", "camera.json"):
        with page.expect_download() as download:
            page.locator(f"#result a[download='{name}']").click()
        shutil.copyfile(download.value.path(), tmp_path / name)
    assert Environment.load(tmp_path / "light.exr").texels.mean() > 0.05
    light = json.loads((tmp_path / "light.light.json").read_text())
    assert light["map"]["copies"] == ["light.hdr"]
    sources = light["sources"]
    assert page.locator("#result .mark:visible").count() == len(sources)
    page.get_by_label("Confidence", exact=True).check()
    page.get_by_label("Render", exact=True).check()
    for picture in page.locator("#result img:visible").all():
        assert picture.evaluate("image => image.decode().then(() => image.naturalWidth)") > 0

    trimesh.creation.icosphere(subdivisions=1, radius=0.5).export(tmp_path / "thing.glb")
    page.locator("summary", has_text="Put your own object").click()
    page.set_input_files("input[aria-label='Choose a GLB file']", tmp_path / "thing.glb")
    page.get_by_text("Put it in", exact=True).click()
    page.wait_for_selector("img[alt='thing.glb in the photo'], #result .failed")
    assert page.locator("#result .failed").count() == 0, page.inner_text("#result .failed")
    with page.expect_download() as download:
        page.locator("a[download='inserted.png']").click()
    before, after = (
        np.asarray(Image.open(path).convert("RGBA"), np.int32) for path in (photo, download.value.path())
    )
    assert before.shape == after.shape
    assert np.abs(before - after).max() > 20

    page.get_by_text("See the object under this light").click()
    page.wait_for_selector("#stage[data-run='0']")
    assert page.input_value("#light").startswith("task:")


@pytest.mark.long
def test_a_worker_that_is_killed_costs_one_sentence(page, server, run):
    with page.expect_response("**/load"):
        page.goto(f"{server.url}#photo")
    worker = idle_worker(server)
    os.kill(worker, signal.SIGSTOP)  # or it may be done before it is killed
    page.set_input_files("#photo-file", run.path.parent / "scene" / "train" / "train_00.png")
    page.wait_for_selector("#result >> text=/starting/")
    os.kill(worker, signal.SIGKILL)
    page.wait_for_selector("#result .failed")
    assert "has ended" in page.inner_text("#result .failed")


def idle_worker(server) -> int:
    """Return the process that computes, once it has loaded the run that the page has asked for."""
    for _ in range(600):
        if server.tasks.all() and not server.tasks.busy:
            return server.tasks.pool.slots[0].process.pid
        time.sleep(0.1)
    raise AssertionError("the run was never loaded")


def test_files_that_cannot_be_used_cost_one_sentence_each(page, server, tmp_path):
    open_object(page, server)
    write_exr(tmp_path / "nan.exr", np.full((4, 8, 3), np.nan, np.float32))
    (tmp_path / "notes.png").write_text("hello")
    (tmp_path / "large.exr").touch()
    os.truncate(tmp_path / "large.exr", 500 * 2**20)
    for file, words in (("nan.exr", "NaN"), ("notes.png", "no OpenEXR"), ("large.exr", "too large")):
        page.set_input_files("#light-file", tmp_path / file)
        page.wait_for_selector(f".message >> text={words}")
        assert file in page.inner_text("#messages")
        page.locator(".message button").first.click()
    page.goto(f"{server.url}#photo")
    page.set_input_files("#photo-file", tmp_path / "notes.png")
    page.wait_for_selector(".message >> text=notes.png")
    page.said = [text for text in page.said if NETWORK not in text]


def test_a_training_is_watched_live(page, server, begun):
    page.goto(f"{server.url}#training")
    page.select_option("#run", "1")
    page.wait_for_selector("text=In training")
    page.wait_for_selector("text=2 of 10")
    begun.append_metrics("decompose", 5, {"stage": "pass2", "loss": 0.125})
    begun.append_metrics("decompose", 7, {"stage": "pass2", "held_out_before": 20.0, "held_out": 21.5})
    page.wait_for_selector("text=7 of 10")
    page.wait_for_selector("text=21.50 dB")
    page.wait_for_selector("text=0.125")
    ObjectVerdict(0.04, photos=5).save(begun.verdict_file)
    page.wait_for_selector("text=The object is good")
    assert "decompose starts" in page.inner_text("#page-training")
    page.select_option("#run", "0")
    page.wait_for_selector("text=The finished object.")


def test_what_is_seen_of_a_run_goes_when_another_is_chosen(page, server):
    open_object(page, server)
    page.select_option("#stand", "1")
    page.wait_for_selector("#wipe-photo:not([hidden])")
    page.select_option("#run", "1")
    page.wait_for_selector("#stage-note >> text=no object yet")
    assert page.locator("#stage[data-run]").count() == 0
    assert page.input_value("#stand") == ""
    assert page.locator("#wipe-photo:visible").count() == 0
    page.select_option("#run", "0")
    page.wait_for_selector("#stage[data-run='0']")
    assert page.locator("#messages .message").count() == 0


def test_an_object_that_comes_late_is_not_shown_as_that_of_another_run(page, server):
    held = []
    page.route("**/runs/0/object.glb", lambda route: held.append(route))
    page.goto(server.url)
    while not held:
        page.wait_for_timeout(50)
    page.select_option("#run", "1")
    page.wait_for_selector("#stage-note >> text=no object yet")
    with page.expect_response("**/object.glb"):
        held[0].continue_()
    page.wait_for_timeout(500)
    assert page.locator("#stage[data-run]").count() == 0


def test_a_prediction_goes_on_while_the_server_cannot_be_asked(page, server, run):
    page.goto(f"{server.url}#photo")
    missed = []

    def miss(route):
        missed.append(route.request.url)
        if len(missed) > 3:
            route.continue_()
        else:
            route.abort()

    page.route(re.compile(r"/api/tasks/[^/]+$"), miss)
    page.set_input_files("#photo-file", run.path.parent / "scene" / "train" / "train_01.png")
    page.wait_for_selector("#result .verdict:not(.failed)")
    assert len(missed) > 3
    page.said = [text for text in page.said if NETWORK not in text]


def paint_a_line(page):
    """Paint along the upper edge of the photo on the easel."""
    page.wait_for_selector(".shots [aria-current]")
    page.locator(".easel canvas").scroll_into_view_if_needed()
    easel = page.locator(".easel canvas").bounding_box()
    corner = [easel["x"] + 0.03 * easel["width"], easel["y"] + 0.05 * easel["height"]]
    page.mouse.move(*corner)
    page.mouse.down()
    page.mouse.move(corner[0] + 0.2 * easel["width"], corner[1], steps=5)
    page.mouse.up()


def test_a_painted_mask_is_saved_where_it_was_painted(page, server, scene, other_scene):
    page.goto(f"{server.url}#masks")
    page.get_by_label("Scene").select_option("1")
    page.wait_for_selector("text=Doubtful masks come first")
    page.wait_for_selector(".shots img[src*='scenes/1']")
    page.get_by_label("Paint: add").check()
    paint_a_line(page)
    page.once("dialog", lambda dialog: dialog.dismiss())
    page.get_by_label("Scene").select_option("0")
    assert page.get_by_label("Scene").input_value() == "1"
    before = [(folder / "masks" / "b.png").read_bytes() for folder in (scene, other_scene)]
    page.get_by_text("Save the mask").click()
    page.wait_for_selector(".message >> text=give its prepare command once more")  # it was made by hand
    after = [(folder / "masks" / "b.png").read_bytes() for folder in (scene, other_scene)]
    assert [a == b for a, b in zip(before, after, strict=True)] == [True, False]


def test_a_mask_that_does_not_come_leaves_nothing_to_save(page, server):
    page.goto(f"{server.url}#masks")
    page.wait_for_selector(".shots [aria-current]")
    page.route(re.compile("scenes/0/photos/0/mask"), lambda route: route.abort())
    page.get_by_label("Paint: add").check()
    page.locator(".shots button").nth(1).click()
    page.wait_for_selector(".message >> text=cannot be shown")
    box = page.locator(".easel canvas").bounding_box()
    page.mouse.click(box["x"] + 10, box["y"] + 10)
    page.get_by_text("Save the mask").click()
    page.wait_for_selector(".message >> text=Nothing has been painted")
    page.said = [text for text in page.said if NETWORK not in text]


def test_a_mask_is_painted_and_a_box_is_kept(page, server, scene):
    page.goto(f"{server.url}#masks")
    page.wait_for_selector(".easel img[alt='The photo b']")  # that is doubtful
    before = read_mask(scene / "masks" / "b.png")
    page.get_by_label("Paint: add").check()
    paint_a_line(page)
    page.get_by_text("Save the mask").click()
    page.wait_for_selector(".message >> text=give its prepare command once more")
    after = read_mask(scene / "masks" / "b.png")
    assert after.shape == before.shape
    assert after[:6, :20].max() > 0.9
    assert np.abs(after[20:40, 30:50] - before[20:40, 30:50]).max() < 0.1
    page.get_by_label("Box", exact=True).check()
    for word, share in (("left", 25), ("top", 25), ("right", 75), ("bottom", 75)):
        page.get_by_label(f"Box, {word}, percent").fill(str(share))
        page.keyboard.press("Tab")
    page.get_by_text("Keep the box").click()
    page.wait_for_selector("text=The box is kept")
    assert shlex.split(page.inner_text(".command code"))[-1] == str(scene)
    assert json.loads((scene / "hint.json").read_text()) == {"photo": "b", "box": [20, 15, 60, 45]}


def test_a_click_corrects_all_masks_and_is_taken_back(page, server, box_scene):
    folder, labelled = box_scene

    def masks():
        return {path.stem: path.read_bytes() for path in (folder / "masks").iterdir()}

    before = masks()
    page.goto(f"{server.url}#masks")
    page.get_by_label("Scene").select_option("2")
    page.wait_for_selector(".shots img[src*='scenes/2']")
    page.locator(".shots button", has_text="p_1").click()
    page.wait_for_selector(".easel img[alt='The photo p_1']")
    page.wait_for_selector(".shots [aria-current] >> text=p_1")
    easel = page.locator(".easel canvas")
    easel.scroll_into_view_if_needed()
    size = easel.bounding_box()
    x, y = shown_at(labelled, 1, BLOCK.mean(axis=0))
    easel.click(position={"x": x * size["width"], "y": y * size["height"]})
    page.wait_for_selector("text=All masks have taken it up")
    page.wait_for_selector(".shots >> text=p_1, corrected")
    assert sum(before[name] != after for name, after in masks().items()) > 1
    page.get_by_label("Click: the object").check()
    easel.click(position={"x": 0.5 * size["width"], "y": 0.6 * size["height"]})
    page.wait_for_selector(".message >> text=inside of the mask already")
    page.get_by_text("Forget this photo's corrections").click()
    page.wait_for_selector(".shots:not(:has-text('corrected'))")
    assert masks() == before


def test_it_fits_a_telephone(page, server):
    page.set_viewport_size({"width": 390, "height": 844})
    open_object(page, server)
    for name in ("object", "photo", "training", "masks"):
        page.goto(f"{server.url}#{name}")
        page.wait_for_selector(f"#page-{name}:not([hidden])")
        page.wait_for_timeout(150)
        assert page.evaluate("document.documentElement.scrollWidth") <= 390, name


@pytest.mark.long
def test_two_tabs_see_the_same_and_a_lost_server_is_said(page, server):
    """The last one, as it takes the server away for a while."""
    open_object(page, server)
    second = page.context.new_page()
    second.goto(f"{server.url}#photo")
    second.wait_for_selector("#recent img, #drop:visible")
    second.close()
    server.stop()
    page.wait_for_selector(".message >> text=does not answer")
    server.start()
    page.wait_for_selector(".message >> text=is back")
    page.said = [text for text in page.said if NETWORK not in text]
