// The kinds of nodes, as buttons that insert one where the cursor is.

const indentOf = (text) => /^ */.exec(text)[0].length;
const holds = (key) => ["root", "child", "children"].includes(key);

// The next line with text, or undefined.
function following(doc, number) {
  for (let n = number + 1; n <= doc.lines; n++) if (doc.line(n).text.trim()) return doc.line(n).text;
  return undefined;
}

// The line with which what stands deeper than a column ends.
function endBelow(doc, number, column) {
  let last = number;
  for (let n = number + 1; n <= doc.lines; n++) {
    const { text } = doc.line(n);
    if (!text.trim()) continue;
    if (indentOf(text) <= column) break;
    last = n;
  }
  return doc.line(last);
}

// Where a node fits: behind which line, at which column, as an item or not; undefined if nowhere.
function slot(doc, number) {
  const outline = Outline.before(doc, number + 1);
  const { frames, top } = outline;
  const line = doc.line(number);
  if (/^ *(- +)*-\s*$/.test(line.text)) return { here: true, line }; // an item that is to be written
  const key = top && !top.list ? lastOf(top.keys) : undefined;
  if (holds(key) && !top.keys.get(key)) {
    const next = following(doc, number) ?? "";
    const deeper = indentOf(next) > top.column || (key === "children" && /^ *-/.test(next) && indentOf(next) === top.column);
    if (key === "children") return { line, column: deeper ? indentOf(next) : top.column + 2, item: true };
    if (!deeper) return { line, column: top.column + 2, item: false };
  }
  const lists = frames.filter((frame, i) => frame.list && lastOf(frames[i - 1]?.keys ?? new Map()) === "children");
  if (lists.length) return { line: endBelow(doc, number, lists.at(-1).column), column: lists.at(-1).column, item: true };
  return undefined;
}

// At the cursor; where no node fits there, behind the last one of the first list.
function insertNode(view, kind) {
  const { doc, selection } = view.state;
  let number = doc.lineAt(selection.main.head).number;
  while (number > 1 && !doc.line(number).text.trim()) number--;
  let at = slot(doc, number);
  if (!at) {
    const list = Outline.before(doc, doc.lines + 1).frames.find((frame) => frame.list);
    if (!list) return "a node fits below root:, child: or children:; put the cursor there";
    number = doc.lines;
    while (!doc.line(number).text.trim()) number--;
    at = { line: doc.line(number), column: list.column, item: true };
  }
  const lead = at.here ? (/\s$/.test(at.line.text) ? "" : " ") : `\n${" ".repeat(at.column)}${at.item ? "- " : ""}`;
  view.dispatch({ changes: { from: at.line.to, insert: lead } });
  const from = at.line.to + lead.length;
  const line = view.state.doc.lineAt(from);
  view.focus();
  insertSnippet(view, template(kind, tabsTo(line, from - line.from)), from, from);
  return "";
}

function buildPalette(view, place, tell) {
  const group = ({ required }) => (required.includes("children") ? "Composites" : required.includes("child") ? "Decorators" : "Leaves");
  const groups = Object.groupBy(Object.keys(definitions.node.properties), (kind) => group(definitions[`node-${kind}`]));
  for (const [name, of] of Object.entries(groups)) {
    const buttons = of.map((kind) => {
      const button = make("button", kind, () => tell(insertNode(view, kind)));
      button.title = definitions.node.properties[kind].description;
      return button;
    });
    const row = make("p", "");
    row.append(make("span", name), ...buttons);
    place.append(row);
  }
}
