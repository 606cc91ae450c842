"use strict";

// How a run stood at any of its ticks. The data holds only what changed; every so often a copy of everything is kept,
// so that a jump costs at most so many changes, however long the run.
const EVERY = 256;

class Moment {
  constructor(tree, states, board) {
    this.tree = tree; // number of the tree in force
    this.states = states; // by number of the node; undefined: not begun
    this.board = board; // Map, key to value
  }

  copy() {
    return new Moment(this.tree, this.states.slice(), new Map(this.board));
  }
}

class Playback {
  constructor(data) {
    this.trees = [];
    this.numbers = []; // of each tree: path to the number of the node
    this.frames = [];
    this.end = data.end;
    this.spans = new Map(); // path to [frame, standing] wherever that changed
    this.failures = []; // frames at which a node failed, with the deepest of them
    this.moment = new Moment(0, new Array(data.trees[0].length), new Map());
    this.frame = -1;
    this.latest = this.moment.copy(); // after the last frame
    this.copies = []; // before frame 0, EVERY, 2 EVERY, ...
    this.add(data);
  }

  // Take in what follows, of a run that still goes on.
  add({ trees = [], frames = [] }) {
    for (const nodes of trees) {
      this.trees.push(nodes);
      this.numbers.push(new Map(nodes.map((node, i) => [node.path, i])));
    }
    if (!this.copies.length) this.copies.push(this.latest.copy());
    for (const frame of frames) {
      const i = this.frames.push(frame) - 1;
      if (i && i % EVERY === 0) this.copies.push(this.latest.copy());
      this.apply(this.latest, frame);
      this.note(this.latest, frame, i);
    }
  }

  get lastTick() {
    return Math.max(this.end.tick, this.frames.length ? this.frames.at(-1).tick : 0);
  }

  note(moment, frame, i) {
    const nodes = this.trees[moment.tree];
    let failed = -1;
    for (const number of Object.keys(frame.nodes ?? {})) {
      const { path, depth } = nodes[number];
      const now = frame.nodes[number].ended ?? frame.nodes[number].is;
      if (!this.spans.has(path)) this.spans.set(path, []);
      const spans = this.spans.get(path);
      if (spans.length && spans.at(-1)[1] === now) continue;
      spans.push([i, now]);
      if (now === "failure" && (failed < 0 || depth > nodes[failed].depth)) failed = Number(number);
    }
    if (failed >= 0) this.failures.push({ frame: i, path: nodes[failed].path, number: failed });
  }

  apply(moment, frame) {
    if (frame.tree !== undefined) {
      const old = this.trees[moment.tree];
      const states = new Array(this.trees[frame.tree].length);
      moment.states.forEach((state, i) => {
        const number = this.numbers[frame.tree].get(old[i].path);
        if (number !== undefined) states[number] = state;
      });
      moment.tree = frame.tree;
      moment.states = states;
    }
    for (const number in frame.nodes) moment.states[number] = frame.nodes[number];
    for (const key in frame.board) {
      if (frame.board[key] === null) moment.board.delete(key);
      else moment.board.set(key, frame.board[key]);
    }
  }

  // The last frame at or before a tick; -1 before the first.
  frameAt(tick) {
    let low = 0;
    let high = this.frames.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.frames[middle].tick <= tick) low = middle + 1;
      else high = middle;
    }
    return low - 1;
  }

  // How everything stands after a frame. The moment is the same object every time.
  at(frame) {
    const nearest = Math.floor((frame + 1) / EVERY);
    if (this.frame > frame || this.frame < nearest * EVERY - 1) {
      const kept = Math.min(nearest, this.copies.length - 1);
      this.moment = this.copies[kept].copy();
      this.frame = kept * EVERY - 1;
    }
    while (this.frame < frame) this.apply(this.moment, this.frames[++this.frame]);
    return this.moment;
  }

  // Simulated time of a tick: those between two frames are evenly spaced.
  timeAt(tick) {
    const i = this.frameAt(tick);
    const before = i >= 0 ? this.frames[i] : { tick: 0, time: 0 };
    const after = i + 1 < this.frames.length ? this.frames[i + 1] : this.end;
    if (after.tick <= before.tick) return before.time;
    const part = Math.min((tick - before.tick) / (after.tick - before.tick), 1);
    return before.time + part * (after.time - before.time);
  }
}

// Time that a node has taken, at a simulated time; undefined where it counts none.
function elapsed(state, time) {
  return state.began === undefined ? state.elapsed : time - state.began;
}

if (typeof module !== "undefined") module.exports = { Playback, elapsed };
