// What ties the parts together; it comes last. The others use what is named here once the page has started.

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

function pill(is, word = marks[is].word) {
  const mark = make("span", { cls: "pill", text: `${marks[is].unicode} ${word}` });
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
    log.take();
    const handoff = log.entries.findLast((e) => e.more && e.path === node.path && e.frame <= still.frame);
    if (handoff) entry("last handoff", handoff.text, ...handoff.more.map((text) => make("p", { text })));
    parts.push(list, changes(node.path));
  } else if (state?.feedback) parts.push(make("p", { text: state.feedback }));
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

function start() {
  document.title = data.name;
  $("name").textContent = data.name;
  $("about").textContent = [data.instruction, data.about].filter(Boolean).join("  ");
  $("outline").classList.toggle("plain", !play);
  outline.build(data.trees[0]);
  if (play) startPlayer();
  else {
    outline.show(new Moment(0, data.states ?? [], new Map()), 0);
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
  if (data.live) live.start();
}

function showWhy() {
  const { path, why = "" } = play.end;
  const where = path ? [make("button", { cls: "link", text: path, on: () => outline.pick(path) })] : [];
  $("why").replaceChildren(...where, make("span", { text: `${where.length ? ": " : ""}${why}` }));
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
  showWhy();
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
  let wide = 0; // not only a window that is resized makes it wider or narrower: a scrollbar does, too
  new ResizeObserver(() => wide !== $("strip").clientWidth && ((wide = $("strip").clientWidth), redraw())).observe($("strip"));
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
