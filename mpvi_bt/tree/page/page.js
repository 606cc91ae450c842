const data = JSON.parse(document.getElementById("data").textContent);
const marks = data.marks;
const play = data.frames ? new Playback(data) : null;
const $ = (id) => document.getElementById(id);
const still = { tick: 0, frame: -1 }; // what is shown

// An element with text (never markup), classes and children.
function make(tag, { text, cls, title, on } = {}, children = []) {
  const element = document.createElement(tag);
  if (text !== undefined) element.textContent = text;
  if (cls) element.className = cls;
  if (title) element.title = title;
  if (on) element.addEventListener("click", on);
  element.append(...children);
  return element;
}

// ---------------------------------------------------------------------------------------------------- the outline

const outline = {
  rows: [], // by number of the node: its elements
  nodes: [],
  folded: new Set(), // paths
  picked: null, // path
  query: "",

  build(nodes) {
    this.nodes = nodes;
    this.numbers = new Map(nodes.map((node, i) => [node.path, i]));
    this.branches = new Set(nodes.map((node) => node.parent));
    this.rows = nodes.map((node, i) => this.row(node, i));
    $("outline").replaceChildren(...this.rows.map((row) => row.line));
    if (!this.numbers.has(this.picked)) this.picked = nodes[0].path;
    this.layOut();
    this.mark();
  },

  row(node, i) {
    const part = (cls, text) => make("span", { cls, text });
    const row = {
      state: null,
      mark: part("mark", ""),
      time: part("time", ""),
      bar: part("bar", ""),
      feedback: part("feedback", ""),
      twist: part("twist", ""),
    };
    row.bar.append(part("", ""));
    row.line = make("div", { cls: `line ${node.family}`, on: (event) => this.clicked(event, node) }, [
      part("indent", ""), row.twist, row.mark,
      ...(node.sign ? [part("sign", node.sign)] : []),
      part("label", node.label), row.time, row.bar, row.feedback,
    ]);
    row.line.style.setProperty("--depth", node.depth);
    row.line.setAttribute("role", "treeitem");
    row.line.setAttribute("aria-level", node.depth + 1);
    row.line.tabIndex = -1;
    row.line.dataset.number = i;
    return row;
  },

  // Which lines are there: not below a folded node, and where a filter is set, part of a way to what fits it.
  layOut() {
    const wanted = this.query && new Set();
    if (wanted) {
      this.nodes.forEach((node, i) => {
        const text = `${node.label} ${node.kind} ${this.rows[i].feedback.textContent}`.toLowerCase();
        if (!text.includes(this.query)) return;
        for (let at = i; at >= 0 && !wanted.has(at); at = this.nodes[at].parent) wanted.add(at);
      });
    }
    const open = [];
    this.nodes.forEach((node, i) => {
      const above = node.parent < 0 || open[node.parent];
      const folded = !wanted && this.folded.has(node.path);
      open[i] = above && !folded;
      const row = this.rows[i];
      row.line.hidden = wanted ? !wanted.has(i) : !above;
      if (this.branches.has(i)) {
        row.line.setAttribute("aria-expanded", String(!folded));
        row.twist.textContent = folded ? "▸" : "▾";
      }
    });
  },

  // Take over the states of a moment; only lines that changed are touched.
  show(moment, time) {
    this.rows.forEach((row, i) => {
      const state = moment.states[i] ?? { is: "idle" };
      if (row.state !== state) {
        row.state = state;
        const { unicode, word } = marks[state.is];
        row.mark.textContent = unicode;
        row.mark.title = word;
        row.line.dataset.is = state.is;
        row.feedback.textContent = state.feedback ?? "";
        row.feedback.title = state.feedback ?? "";
        row.timed = null;
      }
      this.showTime(row, state, time);
    });
  },

  showTime(row, state, time) {
    const passed = state.is === "idle" || state.is === "interrupted" ? undefined : elapsed(state, time);
    const left = state.limit && state.is === "running" ? `, ${Math.max(state.limit - passed, 0).toFixed(1)} s left` : "";
    const text = passed === undefined ? "" : `${passed.toFixed(1)} s${left}`;
    if (row.timed === text) return;
    row.timed = text;
    row.time.textContent = text;
    row.bar.hidden = !(text && state.limit);
    row.bar.firstChild.style.width = `${Math.min(passed / state.limit, 1) * 100}%`;
  },

  // Fold what neither runs nor failed, and bring what runs into view.
  follow(moment) {
    this.folded.clear();
    let deepest = 0;
    this.nodes.forEach((node, i) => {
      const is = moment.states[i]?.is;
      if (i && this.branches.has(i) && is !== "running" && is !== "failure") this.folded.add(node.path);
      if (is === "running" && node.depth > this.nodes[deepest].depth) deepest = i;
    });
    this.layOut();
    this.rows[deepest].line.scrollIntoView({ block: "nearest" });
  },

  fold(path, folded) {
    if (folded) this.folded.add(path);
    else this.folded.delete(path);
    $("follow").checked = false;
    this.layOut();
  },

  clicked(event, node) {
    this.pick(node.path);
    const twisted = event.target.classList.contains("twist");
    if (this.branches.has(this.numbers.get(node.path)) && (twisted || event.detail === 2)) {
      this.fold(node.path, !this.folded.has(node.path));
    }
  },

  // Choose a node, unfolding what hides it.
  pick(path, focus = true) {
    const number = this.numbers.get(path);
    if (number === undefined) return;
    for (let at = this.nodes[number].parent; at >= 0; at = this.nodes[at].parent) this.folded.delete(this.nodes[at].path);
    this.picked = path;
    this.layOut();
    this.mark();
    const { line } = this.rows[number];
    if (focus) line.focus();
    line.scrollIntoView({ block: "nearest" });
    showNode();
  },

  mark() {
    const picked = this.numbers.get(this.picked);
    this.rows.forEach((row, i) => {
      row.line.tabIndex = i === picked ? 0 : -1;
      row.line.setAttribute("aria-selected", String(i === picked));
    });
  },

  // The keys of a tree, as screen readers expect them.
  key(event) {
    const at = Number(event.target.dataset?.number);
    if (Number.isNaN(at) || event.altKey || event.ctrlKey || event.metaKey) return false;
    const node = this.nodes[at];
    const branch = this.branches.has(at);
    const folded = this.folded.has(node.path);
    const shown = this.rows.flatMap((row, i) => (row.line.hidden ? [] : [i]));
    const place = shown.indexOf(at);
    const to = (i) => i !== undefined && this.pick(this.nodes[i].path);
    const keys = {
      ArrowDown: () => to(shown[place + 1]),
      ArrowUp: () => to(shown[place - 1]),
      Home: () => to(shown[0]),
      End: () => to(shown.at(-1)),
      ArrowRight: () => (branch && folded ? this.fold(node.path, false) : branch && to(shown[place + 1])),
      ArrowLeft: () => (branch && !folded ? this.fold(node.path, true) : node.parent >= 0 && to(node.parent)),
      Enter: () => branch && this.fold(node.path, !folded),
    };
    if (!keys[event.key]) return false;
    keys[event.key]();
    return true;
  },
};

// ----------------------------------------------------------------------------------------------------- the side

function pill(is) {
  const mark = make("span", { cls: "pill", text: `${marks[is].unicode} ${marks[is].word}` });
  mark.dataset.is = is;
  return mark;
}

function showNode() {
  const number = outline.numbers.get(outline.picked);
  const node = outline.nodes[number];
  const state = outline.rows[number].state;
  const parts = [
    make("p", { cls: "title", text: node.label }),
    make("p", { cls: "dim", text: `${node.kind.replaceAll("_", " ")}: ${node.about}` }),
    make("p", { cls: "path", text: node.path }),
  ];
  if (play) {
    const list = make("dl");
    const entry = (name, ...shown) => list.append(make("dt", { text: name }), make("dd", {}, shown));
    entry("status", pill(state?.is ?? "idle"));
    const { reason, evidence, feedback } = state ?? {};
    if (reason) entry("reason", reason);
    if (evidence) entry("evidence", evidence);
    if (feedback && feedback !== `${reason}: ${evidence}`) entry("feedback", feedback);
    if (state?.origin && state.origin !== node.path) {
      entry("came from", make("button", { cls: "link", text: state.origin, on: () => outline.pick(state.origin) }));
    }
    parts.push(list, changes(node.path));
  }
  $("node").lastElementChild.replaceChildren(...parts);
}

// When a node changed, the changes about now; each leads to its tick.
function changes(path) {
  const spans = play.spans.get(path) ?? [];
  const now = spans.findLastIndex(([frame]) => frame <= still.frame);
  const first = Math.max(0, Math.min(now - 6, spans.length - 12));
  const rows = spans.slice(first, first + 12).map(([frame, is], i) => {
    const { tick, time } = play.frames[frame];
    const row = make("button", { cls: "link", on: () => seek(tick) }, [
      make("span", { text: `${time.toFixed(1)} s` }), pill(is), make("span", { cls: "dim", text: `tick ${tick}` }),
    ]);
    if (first + i === now) row.setAttribute("aria-current", "true");
    return row;
  });
  const rest = spans.length - rows.length;
  const more = rest > 0 ? [make("p", { cls: "dim", text: `and ${rest} more` })] : [];
  return make("div", { cls: "history" }, [...rows, ...more]);
}

function showBoard(moment) {
  $("board").hidden = moment.board.size === 0;
  const new_ = play.frames[still.frame]?.board ?? {};
  $("board").lastElementChild.replaceChildren(
    ...[...moment.board].sort().map(([key, value]) =>
      make("tr", { cls: Object.hasOwn(new_, key) ? "new" : "" }, [
        make("th", { text: key }), make("td", { text: value }),
      ]),
    ),
  );
}

// --------------------------------------------------------------------------------------------------- the player

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
  }
  $("slider").value = still.tick;
  $("slider").setAttribute("aria-valuetext", `tick ${still.tick}, ${time.toFixed(1)} seconds`);
  $("clock").textContent = `tick ${still.tick} of ${play.lastTick}   ${time.toFixed(2)} s`;
  $("head").style.left = `${strip.left + (still.tick / Math.max(play.lastTick, 1)) * strip.width()}px`;
  const over = still.tick >= play.end.tick;
  const { is, text } = over ? play.end : { is: "running", text: "running" };
  $("outcome").dataset.is = is;
  $("outcome").textContent = `${marks[is].unicode} ${text}`;
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
    $("play").textContent = this.running ? "⏸" : "▶";
    $("play").setAttribute("aria-label", this.running ? "Pause" : "Play");
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
        pen.fillStyle = colors[is];
        if (is === "running") return pen.fillRect(from, middle - 5, Math.max(until - from, 1.5), 10);
        pen.fillRect(from, middle - 5, 3, 10); // how it ended, and, thinly, that it stayed so
        pen.globalAlpha = 0.35;
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

// ----------------------------------------------------------------------------------------------------- the start

function start() {
  document.title = data.name;
  $("name").textContent = data.name;
  $("about").textContent = [data.instruction, data.about].filter(Boolean).join("  ");
  $("outline").classList.toggle("plain", !play);
  outline.build(data.trees[0]);
  if (play) startPlayer();
  else {
    outline.show(new Moment(0, [], new Map()), 0);
    showNode();
  }

  $("filter").addEventListener("input", () => {
    outline.query = $("filter").value.trim().toLowerCase();
    outline.layOut();
  });
  const foldAll = (folded) => {
    $("follow").checked = false;
    outline.folded = new Set(folded ? outline.nodes.slice(1).map((node) => node.path) : []);
    outline.layOut();
  };
  $("unfold").addEventListener("click", () => foldAll(false));
  $("fold").addEventListener("click", () => foldAll(true));
  document.addEventListener("keydown", (event) => pressed(event) && event.preventDefault());
}

function startPlayer() {
  for (const id of ["player", "following", "legend", "outcome"]) $(id).hidden = false;
  $("slider").max = play.lastTick;
  $("slider").addEventListener("input", () => seek(Number($("slider").value)));
  const buttons = {
    play: () => player.toggle(),
    back: () => player.change(-1),
    forward: () => player.change(1),
    "failed-before": () => player.failure(-1),
    "failed-next": () => player.failure(1),
  };
  for (const [id, act] of Object.entries(buttons)) $(id).addEventListener("click", act);
  for (const id of ["failed-before", "failed-next"]) $(id).disabled = !play.failures.length;
  $("speed").value = play.end.time > 240 ? "16" : play.end.time > 20 ? "4" : "1";
  $("follow").addEventListener("change", () => $("follow").checked && outline.follow(play.at(still.frame)));
  $("legend").lastElementChild.append(...Object.keys(marks).map((is) => make("li", {}, [pill(is)])));
  if (play.end.path) outline.pick(play.end.path, false);
  if (play.end.why) {
    const where = play.end.path ? [make("button", { cls: "link", text: play.end.path, on: () => outline.pick(play.end.path) })] : [];
    $("why").append(...where, make("span", { text: `${where.length ? ": " : ""}${play.end.why}` }));
  }
  const told = data.facts.filter(([name]) => ["task", "seed"].includes(name)).map(([name, value]) => `${name} ${value}`);
  $("facts").hidden = !data.facts.length;
  $("facts").firstElementChild.textContent = [...told, "settings"].join(", ");
  $("facts").lastElementChild.append(...data.facts.flatMap(([k, v]) => [make("dt", { text: k }), make("dd", { text: v })]));

  $("strip").addEventListener("click", strip.clicked);
  $("strip").addEventListener("pointermove", (event) => event.buttons === 1 && strip.clicked(event));
  const redraw = () => {
    strip.draw();
    seek(still.tick, { keep: true });
  };
  window.addEventListener("resize", redraw);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
  window.addEventListener("hashchange", () => seek(address.tick() ?? still.tick));
  $("follow").checked = data.trees[0].length > 40;
  strip.draw();
  seek(address.tick() ?? data.open ?? play.lastTick, { keep: true });
}

// Whether a key was one of ours.
function pressed(event) {
  const typing = event.target.matches("input[type=search], select");
  if (event.key === "Escape" && event.target === $("filter")) {
    $("filter").value = outline.query = "";
    outline.layOut();
    return true;
  }
  if (typing || event.ctrlKey || event.metaKey || event.altKey) return false;
  if (event.key === "/") return $("filter").focus(), true;
  if (outline.key(event)) return true;
  if (!play) return false;
  const sliding = event.target === $("slider");
  const keys = {
    ",": () => player.change(-1),
    ".": () => player.change(1),
    n: () => player.failure(1),
    N: () => player.failure(-1),
    ...(sliding ? {} : { ArrowLeft: () => player.change(-1), ArrowRight: () => player.change(1) }),
    ...(event.target.matches("button, summary") ? {} : { " ": () => player.toggle() }),
  };
  if (!keys[event.key]) return false;
  keys[event.key]();
  return true;
}

start();
