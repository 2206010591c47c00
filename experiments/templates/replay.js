// Shows the searches of a report one step at a time. Without it, and on paper, all steps are there side by side.
document.documentElement.classList.add("js");
const shows = new Map();  // of each search, what shows one of its steps
for (const story of document.querySelectorAll(".story")) {
  const panels = [...story.querySelectorAll(".panel")];
  const [back, on, whole, play] = story.querySelectorAll("button");
  let timer = null;
  const stop = () => { clearInterval(timer); timer = null; play.textContent = "play"; };
  const slider = story.querySelector("input"), label = story.querySelector("output");
  const others = () => [...story.parentElement.querySelectorAll(":scope > .story")].filter((other) => other !== story);
  const linked = story.parentElement.matches(".linked");
  const show = (step, alone = false) => {
    slider.value = step = Math.max(0, Math.min(panels.length - 1, step));
    panels.forEach((panel, index) => panel.classList.toggle("now", index === step));
    back.disabled = step === 0;
    on.disabled = step === panels.length - 1;
    if (timer && on.disabled) stop();
    label.textContent = `step ${step + 1} of ${panels.length}`;
    if (linked && !alone) others().forEach((other) => shows.get(other)?.(step, true));
  };
  shows.set(story, show);
  back.onclick = () => show(+slider.value - 1);
  on.onclick = () => show(+slider.value + 1);
  slider.oninput = () => show(+slider.value);
  play.onclick = () => {
    if (timer) return stop();
    if (on.disabled) show(0);
    timer = setInterval(() => show(+slider.value + 1), 1200);
    play.textContent = "pause";
  };
  whole.onclick = () => { whole.textContent = story.classList.toggle("whole") ? "one at a time" : "all steps"; };
  story.onkeydown = (event) => {
    const by = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (by && event.target !== slider) show(+slider.value + by);
  };
  show(+story.dataset.start, true);
}
