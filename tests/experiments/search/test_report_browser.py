"""The report in a real browser: nothing overflows, no error is logged, searches step by button, slider and keyboard."""

import json
import re
import shutil
import subprocess
from html import unescape

import pytest

from experiments.scene_choice import SceneChoice
from experiments.search.compare import Compare
from experiments.search.play import Setting

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
pytestmark = [
    pytest.mark.mujoco,
    pytest.mark.torch,
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="no chromium on PATH to open the report with"),
]
FLAGS = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--hide-scrollbars",
    "--enable-logging=stderr",
    "--virtual-time-budget=4000",
]
# Runs inside the page; what it saw becomes the title of the page around it, which --dump-dom prints.
PROBE = """
const wrong = [];
addEventListener("error", (event) => wrong.push(event.message || `cannot load ${event.target.src}`), true);
addEventListener("securitypolicyviolation", (event) => wrong.push(`refused ${event.blockedURI}`));
addEventListener("load", () => {
  const story = document.querySelector(".story"), [back, on, whole, play] = story.querySelectorAll("button");
  const shown = () => [...story.querySelectorAll(".panel")].flatMap((p, i) => p.offsetParent ? [i] : []);
  const seen = { steps: story.querySelectorAll(".panel").length, start: shown(), back: back.disabled };
  on.click();
  seen.on = shown();
  seen.label = story.querySelector("output").textContent;
  seen.linked = [...story.parentElement.querySelectorAll("output")].map((label) => label.textContent.slice(0, 6));
  on.dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowRight", bubbles: true }));
  seen.right = shown();
  on.dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowLeft", bubbles: true }));
  back.click();
  seen.home = shown();
  const slider = story.querySelector("input");
  slider.value = slider.max;
  slider.dispatchEvent(new Event("input"));
  seen.end = shown();
  seen.onAtEnd = on.disabled;
  whole.click();
  seen.whole = shown().length;
  play.click();
  seen.playing = [play.textContent, slider.value];
  play.click();
  seen.paused = play.textContent;
  const touched = [...document.querySelectorAll(".touch img")];
  seen.unnamed = touched.filter((image) => !image.alt.includes("belief: ")).length;
  const field = document.querySelector(".filter"), table = field.nextElementSibling;
  const rows = () => [...table.querySelectorAll("tbody tr")].filter((row) => !row.hidden).length;
  const all = rows();
  field.value = "row 7";
  field.dispatchEvent(new Event("input"));
  seen.filtered = [all, rows()];
  seen.lost = [...document.querySelectorAll("nav a")].filter((a) => !document.querySelector(a.hash)).length;
  for (const details of document.querySelectorAll("details")) details.open = true;
  const root = document.documentElement;
  const wide = [...document.body.querySelectorAll("*")].filter((e) =>
    e.getBoundingClientRect().right > innerWidth + 1 && !e.closest(".scroll"));
  Object.assign(seen, { width: root.scrollWidth, window: innerWidth, wide: wide.map((e) => e.outerHTML.slice(0, 99)),
    broken: [...document.images].filter((i) => !i.naturalWidth).length, wrong });
  parent.postMessage(JSON.stringify(seen), "*");
});
"""
# A window has a least width, a frame has none; the page's probe tells the frame's owner what it saw.
FRAME = """<!doctype html><script>addEventListener("message", (event) => { document.title = event.data; });</script>
<body style="margin: 0"><iframe style="border: 0; width: WIDTHpx; height: 900px" src="probed.html"></iframe>"""


@pytest.fixture(scope="module")
def report(tmp_path_factory, usual_pictures):
    """The report of a few searches."""
    folder, setting = tmp_path_factory.mktemp("report"), Setting(SceneChoice("coarse", fidelity="quasistatic"))
    comparison = Compare(
        deciders=("information_gain", "threshold"),
        targets=("cone",),
        episodes=4,
        setting=setting,
        out=folder,
        jobs=1,
    ).play()
    html = comparison.save(folder).read_text()
    rows = "".join(f"<tr><td>row {number}</td></tr>" for number in range(1, 32))  # enough to filter
    return html.replace("<h2", f'<div class="scroll"><table><tbody>{rows}</tbody></table></div><h2', 1)


def look(html, folder, width):
    """What the probe saw in a page of this width, and what the browser logged."""
    probed = html.replace("<meta charset", f"<script>{PROBE}</script><meta charset", 1)
    (folder / "probed.html").write_text(probed, encoding="utf-8")
    page = folder / "frame.html"
    page.write_text(FRAME.replace("WIDTH", str(width)))
    command = [CHROMIUM, *FLAGS, f"--user-data-dir={folder / 'profile'}", "--window-size=1400,1000", "--dump-dom"]
    done = subprocess.run([*command, page.as_uri()], capture_output=True, text=True, timeout=120)
    [title] = re.findall(r"<title>(\{.*?\})</title>", done.stdout, flags=re.S)
    return json.loads(unescape(title)), [line for line in done.stderr.splitlines() if "CONSOLE" in line]


@pytest.mark.parametrize("width", [1280, 390])
def test_the_report_steps_fits_and_logs_no_error(report, tmp_path, width):
    seen, log = look(report, tmp_path, width)
    assert (seen["wrong"], log) == ([], [])
    assert seen["window"] == width
    assert seen["width"] <= width
    assert seen["wide"] == []
    assert seen["broken"] == 0
    last = seen["steps"] - 1
    assert last >= 4
    assert (seen["start"], seen["back"]) == ([0], True)
    assert (seen["on"], seen["label"]) == ([1], f"step 2 of {last + 1}")
    assert (seen["right"], seen["home"]) == ([2], [0])
    assert (seen["end"], seen["onAtEnd"]) == ([last], True)
    assert seen["whole"] == last + 1
    assert (seen["playing"], seen["paused"]) == (["pause", "0"], "play")
    assert (seen["unnamed"], seen["lost"]) == (0, 0)
    assert seen["filtered"] == [31, 1]
    assert seen["linked"] == ["step 2", "step 2"]


def test_the_probe_notices_what_it_is_there_for(report, tmp_path):
    harm = '<div style="width: 1500px">too wide</div><img src="data:image/png;base64,AAAA">'
    harm += '<script>missing();</script><img src="https://example.org/a.png">'
    seen, _ = look(report.replace("</body>", f"{harm}</body>"), tmp_path, 1280)
    assert seen["wide"]
    assert seen["broken"]
    for word in ("missing", "example.org"):
        assert any(word in wrong for wrong in seen["wrong"]), word
