// What goes through the ticks of a run: buttons, slider, address, and the strip of what each leaf did.

function seek(tick, { keep = false } = {}) {
  still.tick = Math.max(0, Math.min(Math.round(tick), play.lastTick));
  const before = still.frame;
  still.frame = play.frameAt(still.tick);
  const moment = play.at(still.frame);
  const time = play.timeAt(still.tick);
  if (outline.nodes !== play.trees[moment.tree]) outline.build(play.trees[moment.tree]);
  outline.show(moment, time);
  if (before !== still.frame || !$("node").lastElementChild.hasChildNodes()) {
    if ($("follow").checked) outline.follow(moment);
    showNode();
    showBoard(moment);
    log.show();
  }
  $("slider").value = still.tick;
  $("slider").setAttribute("aria-valuetext", `tick ${still.tick}, ${time.toFixed(1)} seconds`);
  $("clock").textContent = `tick ${still.tick} of ${play.lastTick}   ${time.toFixed(2)} s`;
  $("head").style.left = `${strip.left + (still.tick / Math.max(play.lastTick, 1)) * strip.width()}px`;
  const over = still.tick >= play.end.tick;
  const { is, text, paused } = over ? play.end : { is: "running", text: "running" };
  $("outcome").dataset.is = is;
  $("outcome").textContent = `${paused ? "▮▮" : marks[is].unicode} ${text}`;
  $("why").hidden = !(over && play.end.why);
  if (!keep) address.set(still.tick);
}

// The address says the tick, so that it can be sent to someone; browsers allow few changes a second.
const address = {
  set(tick) {
    clearTimeout(this.timer);
    this.timer = setTimeout(() => window.history.replaceState(null, "", `#tick=${tick}`), 200);
  },
  tick() {
    const found = /^#tick=(\d+)$/.exec(location.hash);
    return found && Number(found[1]);
  },
};

const player = {
  running: false,

  toggle() {
    this.running = !this.running;
    $("play").textContent = this.running ? "▮▮ Pause" : "▶ Play";
    if (!this.running) return address.set(still.tick);
    this.at = still.tick >= play.lastTick ? 0 : still.tick;
    this.last = performance.now();
    requestAnimationFrame((now) => this.step(now));
  },

  step(now) {
    if (!this.running) return;
    const pace = play.lastTick / Math.max(play.timeAt(play.lastTick), 1e-3); // ticks a second
    this.at += ((now - this.last) / 1000) * pace * Number($("speed").value);
    this.last = now;
    seek(this.at, { keep: true });
    if (this.at >= play.lastTick) this.toggle();
    else requestAnimationFrame((next) => this.step(next));
  },

  // To the next or the last tick at which anything changed; past the last one to the end.
  change(by) {
    if (this.running) this.toggle();
    const before = by < 0 && play.frames[still.frame]?.tick < still.tick ? still.frame : still.frame + by;
    seek(before < 0 ? 0 : (play.frames[before]?.tick ?? play.lastTick));
  },

  failure(by) {
    if (this.running) this.toggle();
    const found = by > 0
      ? play.failures.find(({ frame }) => frame > still.frame)
      : play.failures.findLast(({ frame }) => frame < still.frame);
    if (!found) return;
    seek(play.frames[found.frame].tick);
    outline.pick(found.path);
  },
};

// What every leaf that ever ran did over time, as a strip a leaf.
const strip = {
  row: 15,
  get left() {
    return Math.min(200, Math.round($("strip").clientWidth / 3));
  },
  width: () => Math.max($("strip").clientWidth - strip.left - 10, 50),

  draw() {
    const leaves = [];
    for (const [path, spans] of play.spans) {
      const tree = play.numbers.findIndex((numbers) => numbers.has(path));
      const number = play.numbers[tree].get(path);
      const node = play.trees[tree][number];
      if (node.family === "leaf") leaves.push({ node, number: [tree, number], spans });
    }
    this.leaves = leaves.sort((a, b) => a.number[0] - b.number[0] || a.number[1] - b.number[1]).slice(0, 1000);
    const canvas = $("timeline");
    const [width, height] = [this.left + this.width() + 10, Math.max(leaves.length, 1) * this.row];
    const scale = Math.min(window.devicePixelRatio || 1, 16000 / height);
    canvas.width = width * scale;
    canvas.height = height * scale;
    canvas.style.width = `${width}px`;
    canvas.style.height = $("head").style.height = `${height}px`;
    const pen = canvas.getContext("2d");
    pen.scale(scale, scale);
    const color = (name) => getComputedStyle(document.documentElement).getPropertyValue(name);
    const colors = Object.fromEntries(Object.keys(marks).map((is) => [is, color(`--${is.replace("_", "-")}`)]));
    pen.font = "11px system-ui, sans-serif";
    pen.textBaseline = "middle";
    this.leaves.forEach(({ node, spans }, i) => {
      pen.fillStyle = color("--dim");
      pen.fillText(fitted(pen, node.label, this.left - 14), 0, (i + 0.5) * this.row);
      spans.forEach(([frame, is], k) => {
        if (is === "idle") return;
        const from = this.x(play.frames[frame].tick);
        const until = this.x(k + 1 < spans.length ? play.frames[spans[k + 1][0]].tick : play.lastTick);
        const middle = (i + 0.5) * this.row;
        if (is === "running") {
          pen.fillStyle = colors[spans[k + 1]?.[1] ?? is]; // as it came out, as in reports
          return pen.fillRect(from, middle - 5, Math.max(until - from, 1.5), 10);
        }
        pen.fillStyle = colors[is];
        if (spans[k - 1]?.[1] !== "running") pen.fillRect(from, middle - 5, 3, 10); // it took no time
        pen.globalAlpha = 0.35; // thinly, that it stayed so
        pen.fillRect(from, middle - 1, Math.max(until - from, 1.5), 2);
        pen.globalAlpha = 1;
      });
    });
    $("slider").style.marginLeft = `${this.left - 8}px`; // half a thumb
    $("slider").style.width = `${this.width() + 16}px`;
  },

  x: (tick) => strip.left + (tick / Math.max(play.lastTick, 1)) * strip.width(),

  clicked(event) {
    const box = $("timeline").getBoundingClientRect();
    const leaf = strip.leaves[Math.floor((event.clientY - box.top) / strip.row)];
    const x = event.clientX - box.left - strip.left;
    if (x >= -6) seek((x / strip.width()) * play.lastTick);
    if (leaf && event.type === "click") outline.pick(leaf.node.path, false);
  },
};

function fitted(pen, text, width) {
  if (pen.measureText(text).width <= width) return text;
  let end = text.length;
  while (end > 1 && pen.measureText(`${text.slice(0, end)}…`).width > width) end -= 1 + (end >> 4);
  return `${text.slice(0, end)}…`;
}
