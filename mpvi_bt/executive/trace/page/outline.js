// The tree as an outline that folds, with the states of a moment.

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
      word: part("word", ""),
      time: part("time", ""),
      bar: part("bar", ""),
      feedback: part("feedback", ""),
      twist: part("twist", ""),
    };
    row.bar.append(part("", ""));
    row.line = make("div", { cls: `line ${node.family}`, on: (event) => this.clicked(event, node) }, [
      part("indent", ""), row.twist, row.mark,
      ...(node.sign ? [part("sign", named(node))] : []),
      part("label", node.label), row.word, row.time, row.bar, row.feedback,
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
        row.word.textContent = word;
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

// A sign with the kind of its node, unless the label says it.
function named({ sign, kind, label }) {
  const word = kind.replaceAll("_", " ");
  return label.startsWith(word) ? sign : `${sign} ${word}`;
}
