// The page of a tree that is edited: its text, its problems, and the drawing, which is a page of its own.

const CHECK_MS = 300; // after the last key: who types is not interrupted
let saved = first.text; // as it is on disk
let base = first.base;
let drawing = 0;
let checking = 0;

function make(tag, text, on) {
  const element = document.createElement(tag);
  element.textContent = text;
  if (on) element.addEventListener("click", on);
  return element;
}

const text = () => editor.state.doc.toString();

// The word at a place; columns count code points, as Python does.
function rangeAt(line, column) {
  const found = editor.state.doc.line(Math.min(Math.max(line, 1), editor.state.doc.lines));
  const start = Array.from(found.text).slice(0, Math.max(column - 1, 0)).join("").length;
  const word = /^[\w$]+|^./.exec(found.text.slice(start))?.[0].length ?? 0;
  return { from: found.from + start, to: found.from + start + word };
}

function goTo(line, column) {
  const { from, to } = rangeAt(line, column);
  editor.dispatch({ selection: { anchor: from, head: to }, effects: CodeMirror.EditorView.scrollIntoView(from, { y: "center" }) });
  editor.focus();
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
  const here = problems.filter(({ file, line }) => !file && line);
  const marks = here.map(({ line, column, severity, message }) => (
    { ...rangeAt(line, column), severity: severity === "note" ? "info" : severity, message }
  ));
  editor.dispatch(CodeMirror.setDiagnostics(editor.state, marks));
}

function draw({ since }) {
  clearTimeout(drawing);
  drawing = setTimeout(() => ($("drawing").src = `drawing?${since}`), 100); // the problems first
}

// Take over a text, the cursor where it was: what both begin and end with stays.
function show(wanted) {
  const now = text();
  const most = Math.min(now.length, wanted.length);
  let from = 0;
  while (from < most && now[from] === wanted[from]) from++;
  let end = 0;
  while (end < most - from && now[now.length - 1 - end] === wanted[wanted.length - 1 - end]) end++;
  if (now !== wanted) {
    const changes = { from, to: now.length - end, insert: wanted.slice(from, wanted.length - end) };
    editor.dispatch({ changes, annotations: CodeMirror.Transaction.remote.of(true) });
  }
}

// What is typed and not saved is kept, whatever happens on disk.
function take(data) {
  if (data.unreadable) $("said").textContent = `${data.unreadable}: it is left as it is`;
  if (data.text === saved && data.base === base) return;
  if (text() === saved || text() === data.text) {
    [saved, base] = [data.text, data.base];
    show(saved);
    tell(data.problems, "");
    $("said").textContent = "";
    $("save").disabled = true;
  } else {
    $("said").textContent = "the file has changed on disk, and here too: copy what is yours, then reload";
  }
  draw(data);
}

function typed() {
  $("save").disabled = text() === saved;
  clearTimeout(checking);
  checking = setTimeout(check, CHECK_MS);
}

const post = (to, data) => fetch(to, { method: "POST", body: JSON.stringify(data) }).catch(() => null);

async function check() {
  const asked = text();
  const answer = await post("check", { text: asked });
  if (answer?.ok && asked === text()) tell(await answer.json(), asked === saved ? "" : ", not saved");
}

async function save() {
  const answer = await post("text", { text: text(), base });
  if (answer?.ok) take(await answer.json());
  else $("said").textContent = answer ? await answer.text() : "no connection: not saved";
}

function connected(is, word) {
  $("connection").dataset.is = is;
  $("connection").textContent = word;
}

const yaml = CodeMirror.yaml();
const dark = matchMedia("(prefers-color-scheme: dark)");
const shade = new CodeMirror.Compartment();
const editor = new CodeMirror.EditorView({
  doc: saved,
  parent: $("text"),
  extensions: [
    CodeMirror.EditorView.cspNonce.of(first.nonce),
    CodeMirror.basicSetup,
    yaml,
    yaml.language.data.of({ autocomplete: complete }),
    CodeMirror.lintGutter(),
    CodeMirror.syntaxHighlighting(CodeMirror.classHighlighter),
    shade.of(CodeMirror.EditorView.darkTheme.of(dark.matches)),
    CodeMirror.EditorView.contentAttributes.of({ "aria-label": "The tree as YAML" }),
    CodeMirror.EditorView.updateListener.of(({ docChanged, transactions }) => {
      if (docChanged && !transactions.some((one) => one.annotation(CodeMirror.Transaction.remote))) typed();
    }),
  ],
});
$("name").textContent = first.name;
tell(first.problems, "");
draw(first);
buildPalette(editor, $("palette"), (said) => ($("said").textContent = said));
dark.addEventListener("change", () =>
  editor.dispatch({ effects: shade.reconfigure(CodeMirror.EditorView.darkTheme.of(dark.matches)) }),
);
$("save").addEventListener("click", save);
document.addEventListener("keydown", (event) => {
  if (!(event.ctrlKey || event.metaKey) || event.key !== "s") return;
  event.preventDefault();
  save();
});
window.addEventListener("beforeunload", (event) => {
  if (text() !== saved) event.preventDefault();
});
const source = new EventSource(`events?since=${first.since}`);
source.onopen = () => connected("success", "live");
source.onerror = () => connected("failure", "no connection: trying again");
source.onmessage = (event) => take(JSON.parse(event.data));
