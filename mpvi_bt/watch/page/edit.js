"use strict";

// The page of a tree that is edited: its text, its problems, and the drawing, which is a page of its own.

const $ = (id) => document.getElementById(id);
const first = JSON.parse($("data").textContent);
let saved = first.text; // as it is on disk
let base = first.base;
let drawing = 0;

function make(tag, text, on) {
  const element = document.createElement(tag);
  element.textContent = text;
  if (on) element.addEventListener("click", on);
  return element;
}

function goTo(line, column) {
  const lines = $("text").value.split("\n");
  const start = lines.slice(0, line - 1).reduce((sum, text) => sum + text.length + 1, 0) + Math.max(column - 1, 0);
  $("text").focus();
  $("text").setSelectionRange(start, start + 1);
  $("text").scrollTop = ((line - 8) / lines.length) * $("text").scrollHeight;
}

function draw(data) {
  const { problems } = data;
  $("problems").firstElementChild.textContent = problems.length ? `${problems.length} problem${problems.length > 1 ? "s" : ""}` : "No problems";
  $("problems").lastElementChild.replaceChildren(...problems.map(({ line, column, code, severity, message, file }) => {
    const row = make("button", `${file ? `${file}: ` : ""}${line}:${column}: ${message} [${code}]`, () => goTo(line, column));
    row.className = "link";
    row.dataset.is = severity === "error" ? "failure" : "idle";
    return row;
  }));
  $("problems").dataset.version = data.since;
  clearTimeout(drawing); // the problems first: a dry run takes longer
  drawing = setTimeout(() => ($("drawing").src = `drawing?${data.since}`), 100);
}

// What is typed and not saved is kept, whatever happens on disk.
function take(data) {
  const own = $("text").value !== saved;
  if (data.text === saved && data.base === base) return;
  draw(data); // first: a long text takes longer to lay out
  if (!own || data.text === $("text").value) {
    const at = [$("text").selectionStart, $("text").scrollTop];
    if ($("text").value !== data.text) $("text").value = data.text;
    [$("text").selectionStart, $("text").scrollTop] = at;
    [saved, base] = [data.text, data.base];
    $("said").textContent = "";
  } else {
    $("said").textContent = "the file has changed on disk, and here too: copy what is yours, then reload";
  }
  typed();
}

function typed() {
  $("save").disabled = $("text").value === saved;
}

async function save() {
  const text = $("text").value;
  const answer = await fetch("text", { method: "POST", body: JSON.stringify({ text, base }) }).catch(() => null);
  if (answer?.ok) take(await answer.json());
  else $("said").textContent = answer ? await answer.text() : "no connection: not saved";
}

function connected(is, text) {
  $("connection").dataset.is = is;
  $("connection").textContent = text;
}

$("name").textContent = first.name;
$("text").value = saved;
draw(first);
$("text").addEventListener("input", typed);
$("save").addEventListener("click", save);
document.addEventListener("keydown", (event) => {
  if (!(event.ctrlKey || event.metaKey) || event.key !== "s") return;
  event.preventDefault();
  save();
});
const source = new EventSource(`events?since=${first.since}`);
source.onopen = () => connected("success", "live");
source.onerror = () => connected("failure", "no connection: trying again");
source.onmessage = (event) => take(JSON.parse(event.data));
