"use strict";

// The page of a tree that is edited: its text, its problems, and the drawing, which is a page of its own.

const $ = (id) => document.getElementById(id);
const first = JSON.parse($("data").textContent);
const CHECK_MS = 300; // after the last key: who types is not interrupted
let saved = first.text; // as it is on disk
let base = first.base;
let drawing = 0;
let checking = 0;
let marked = new Set(); // lines with problems

function make(tag, text, on) {
  const element = document.createElement(tag);
  element.textContent = text;
  if (on) element.addEventListener("click", on);
  return element;
}

// Select the word at a place.
function goTo(line, column) {
  const text = $("text").value;
  const lines = text.split("\n");
  const start = lines.slice(0, line - 1).reduce((sum, each) => sum + each.length + 1, 0) + Math.max(column - 1, 0);
  $("text").focus();
  $("text").setSelectionRange(start, start + (/^[\w$]+|^[^\n]/.exec(text.slice(start))?.[0].length ?? 0));
  $("text").scrollTop = ((line - 8) / lines.length) * $("text").scrollHeight;
}

function number() {
  const count = $("text").value.split("\n").length;
  $("lines").textContent = Array.from({ length: count }, (_, i) => `${marked.has(i + 1) ? "●" : " "} ${i + 1}`).join("\n");
  follow();
}

function follow() {
  $("lines").scrollTop = $("text").scrollTop;
}

function tell(problems, where) {
  const count = problems.length ? `${problems.length} problem${problems.length > 1 ? "s" : ""}` : "No problems";
  $("problems").firstElementChild.textContent = count + where;
  $("problems").lastElementChild.replaceChildren(...problems.map(({ line, column, code, severity, message, file }) => {
    const row = make("button", `${file ? `${file}: ` : ""}${line}:${column}: ${message} [${code}]`, () => file || goTo(line, column));
    row.className = "link";
    row.dataset.is = severity === "error" ? "failure" : "idle";
    return row;
  }));
  marked = new Set(problems.filter(({ file }) => !file).map(({ line }) => line));
}

function draw({ problems, since }) {
  const wrong = problems.some(({ severity }) => severity === "error");
  $("problems").dataset.version = since;
  clearTimeout(drawing);
  $("drawing").className = wrong && $("drawing").src ? "stale" : ""; // a drawing stays until there is a better one
  if ($("drawing").className) return;
  drawing = setTimeout(() => ($("drawing").src = `drawing?${since}`), 100); // the problems first
}

// What is typed and not saved is kept, whatever happens on disk.
function take(data) {
  if (data.unreadable) $("said").textContent = `${data.unreadable}: it is left as it is`;
  const own = $("text").value !== saved;
  if (data.text === saved && data.base === base) return;
  if (!own || data.text === $("text").value) {
    tell(data.problems, ""); // first: a long text takes longer to lay out
    draw(data);
    const at = [$("text").selectionStart, $("text").scrollTop];
    if ($("text").value !== data.text) $("text").value = data.text;
    [$("text").selectionStart, $("text").scrollTop] = at;
    [saved, base] = [data.text, data.base];
    $("said").textContent = "";
    $("save").disabled = true;
    number();
  } else {
    $("said").textContent = "the file has changed on disk, and here too: copy what is yours, then reload";
    draw(data);
  }
}

function typed() {
  $("save").disabled = $("text").value === saved;
  number();
  clearTimeout(checking);
  checking = setTimeout(check, CHECK_MS);
}

const post = (to, data) => fetch(to, { method: "POST", body: JSON.stringify(data) }).catch(() => null);

async function check() {
  const text = $("text").value;
  const answer = await post("check", { text });
  if (answer?.ok && text === $("text").value) {
    tell(await answer.json(), text === saved ? "" : ", not saved");
    number();
  }
}

async function save() {
  const answer = await post("text", { text: $("text").value, base });
  if (answer?.ok) take(await answer.json());
  else $("said").textContent = answer ? await answer.text() : "no connection: not saved";
}

// A new line begins below the one before.
function indent(event) {
  if (event.key !== "Enter" || event.shiftKey || event.ctrlKey || event.metaKey || event.isComposing) return;
  const before = $("text").value.slice(0, $("text").selectionStart).split("\n").at(-1);
  event.preventDefault();
  document.execCommand("insertText", false, `\n${/^ */.exec(before)[0]}`); // which can be undone
}

function connected(is, text) {
  $("connection").dataset.is = is;
  $("connection").textContent = text;
}

$("name").textContent = first.name;
$("text").value = saved;
tell(first.problems, "");
number();
draw(first);
$("text").addEventListener("input", typed);
$("text").addEventListener("scroll", follow);
$("text").addEventListener("keydown", indent);
$("save").addEventListener("click", save);
document.addEventListener("keydown", (event) => {
  if (!(event.ctrlKey || event.metaKey) || event.key !== "s") return;
  event.preventDefault();
  save();
});
window.addEventListener("beforeunload", (event) => {
  if ($("text").value !== saved) event.preventDefault();
});
const source = new EventSource(`events?since=${first.since}`);
source.onopen = () => connected("success", "live");
source.onerror = () => connected("failure", "no connection: trying again");
source.onmessage = (event) => take(JSON.parse(event.data));
