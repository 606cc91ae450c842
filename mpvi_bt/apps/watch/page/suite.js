"use strict";

// The page of a suite: how it stands, drawn anew whenever that is told again.

const $ = (id) => document.getElementById(id);
const first = JSON.parse($("data").textContent);

function make(tag, text = "", cls = "", children = []) {
  const element = document.createElement(tag);
  if (text !== "") element.textContent = text;
  if (cls) element.className = cls;
  element.append(...children);
  return element;
}

function link(text, to) {
  const element = make("a", text);
  element.href = to;
  return element;
}

function duration(seconds) {
  if (seconds < 90) return `${seconds.toFixed(0)} s`;
  if (seconds < 5400) return `${(seconds / 60).toFixed(0)} min`;
  return `${(seconds / 3600).toFixed(1)} h`;
}

// From and to, as the command line has it: "2 to 5 min", "40 s to 3 min", or "about 2 min".
function span([low_s, high_s]) {
  const [low, high] = [duration(low_s), duration(high_s)];
  if (low === high) return `about ${low}`;
  const [number, unit] = low.split(" ");
  return `${high.endsWith(` ${unit}`) ? number : low} to ${high}`;
}

// Mean of q with its interval, as the reports write it, and how many episodes it is of. One episode has no interval.
function score(group) {
  if (!group) return [make("td", "", "number")];
  const { q, finished, episodes } = group;
  const cell = make("td", q ? q.mean.toFixed(3) : "–", "number");
  if (q && q.low !== null) cell.append(" ", make("small", `[${q.low.toFixed(3)}, ${q.high.toFixed(3)}]`));
  cell.append(" ", make("small", `${finished}/${episodes}`));
  return [cell];
}

function fill(id, rows) {
  $(id).hidden = !rows.length;
  $(id).querySelector("table").replaceChildren(...rows);
}

function draw(data) {
  document.title = `${data.done}/${data.total} ${data.suite}`;
  $("name").textContent = data.suite;
  const said = [`${data.done} of ${data.total} episodes done`];
  if (data.left_s !== null) said.push(`${span(data.left_s)} left`);
  if (data.mean_q !== null) said.push(`mean q ${data.mean_q.toFixed(3)}`, `${data.succeeded} reached the goal`);
  if (!data.running) said.push(data.done === data.total ? "finished" : "no run is at work");
  $("standing").textContent = said.join(", ");
  $("bar").max = data.total;
  $("bar").value = data.done;
  $("problem").hidden = !data.problem;
  $("problem").textContent = data.problem;
  fill("at-work", data.at_work.map((work) =>
    make("tr", "", "", [
      make("td", `worker ${work.worker}`), make("td", "", "", [link(work.episode, work.link)]),
      make("td", duration(work.since_s) + (work.expected_s === null ? "" : ` of about ${duration(work.expected_s)}`), "number"),
    ]),
  ));
  const tasks = [...new Set(data.methods.flatMap((method) => Object.keys(method.tasks)))];
  const head = make("tr", "", "", [make("th", "task"), ...data.methods.map(({ name }) => make("th", name, "number"))]);
  const row = (name, cls, of) => make("tr", "", cls, [make("th", name), ...data.methods.flatMap((m) => score(of(m)))]);
  fill("scores", data.methods.length ? [
    head, ...tasks.map((task) => row(task, "", (method) => method.tasks[task])),
    row("all", "overall", (method) => method.overall),
  ] : []);
  fill("failures", data.failures.map(({ episode, link: to, q, why }) =>
    make("tr", "", "", [make("td", "", "", [link(episode, to)]), make("td", `q ${q.toFixed(3)}`, "number"), make("td", why)]),
  ));
  fill("broke", data.broke.map(({ episode, kind, message }) =>
    make("tr", "", "", [make("td", episode), make("td", kind), make("td", message)]),
  ));
}

function connected(is, text) {
  $("connection").dataset.is = is;
  $("connection").textContent = text;
}

draw(first);
const source = new EventSource(`events?since=${first.since}`);
source.onopen = () => connected("success", "live");
source.onerror = () => connected("failure", "no connection: trying again");
source.onmessage = (event) => draw(JSON.parse(event.data));
source.addEventListener("closed", () => {
  source.close();
  connected("idle", "the run is over, the server is gone");
});
