// What happened up to the tick that is shown, the latest first: failures, the checker's answers, new plans, handoffs.

const log = {
  MOST: 60,
  taken: 0, // frames that were looked at
  entries: [], // {frame, path, is, about, text, more: of a handoff, its figures}, in the order of time
  failed: 0, // of play.failures

  take() {
    for (; this.failed < play.failures.length; this.failed++) {
      const { frame, path, number } = play.failures[this.failed];
      const state = play.frames[frame].nodes[number];
      const why = [state.reason, state.evidence].filter(Boolean).join(": ") || "failed";
      const text = `${this.label(path)}: ${why}`;
      this.entries.push({ frame, path, is: "failure", about: "failure", text });
    }
    for (; this.taken < play.frames.length; this.taken++) {
      for (const said of play.frames[this.taken].said ?? []) this.entries.push({ frame: this.taken, ...said });
    }
    this.entries.sort((a, b) => a.frame - b.frame);
  },

  label(path) {
    const tree = play.numbers.findLastIndex((numbers) => numbers.has(path));
    return play.trees[tree][play.numbers[tree].get(path)].label;
  },

  show() {
    this.take();
    const past = this.entries.filter(({ frame }) => frame <= still.frame);
    $("log").hidden = !past.length;
    const rows = past.slice(-this.MOST).reverse().map(({ frame, path, is, about, text }) =>
      make("button", { cls: "link", title: path, on: () => this.open(frame, path) }, [
        make("span", { text: `${play.frames[frame].time.toFixed(1)} s` }), pill(is, about), make("span", { text }),
      ]),
    );
    const rest = past.length - rows.length;
    if (rest > 0) rows.push(make("p", { cls: "dim", text: `and ${rest} before` }));
    $("log").lastElementChild.replaceChildren(...rows);
  },

  open(frame, path) {
    seek(play.frames[frame].tick);
    outline.pick(path);
  },
};
