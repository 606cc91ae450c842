"use strict";

// What the editor proposes: keys and values by the schema of trees, at the place in the text where the cursor is.

const $ = (id) => document.getElementById(id);
const first = JSON.parse($("data").textContent);
const { definitions } = first.schema;
const KEY = /^([\w-]+):(?:\s+(.*))?$/;

// The mappings and lists that are open behind some lines, outermost first; a mapping has its keys so far, with the text
// behind each.
class Outline {
  frames = [];

  get top() {
    return this.frames.at(-1);
  }

  // Go on to a column: of a key, or of the dash of an item.
  enter(column, list) {
    while (this.top && (this.top.column > column || (this.top.column === column && this.top.list && !list))) this.frames.pop();
    if (this.top?.column !== column) this.frames.push({ column, list, keys: new Map() });
  }

  // Indent and dashes of a line; what follows them, and its column.
  begin(text) {
    let column = /^ */.exec(text)[0].length;
    let rest = text.slice(column);
    for (let dash; (dash = /^-(?: +|$)/.exec(rest)); ) {
      this.enter(column, true);
      column += dash[0].length;
      rest = rest.slice(dash[0].length);
    }
    return { column, rest };
  }

  line(text) {
    if (/^\s*(#|$)/.test(text)) return;
    const { column, rest } = this.begin(text);
    const key = KEY.exec(rest);
    if (!key) return;
    this.enter(column, false);
    this.top.keys.set(key[1], (key[2] ?? "").replace(/(^|\s)#.*/, "").trim());
  }

  static before(doc, number) {
    const outline = new Outline();
    for (let n = 1; n < number; n++) outline.line(doc.line(n).text);
    return outline;
  }
}

const firstOf = (keys) => keys.keys().next().value;
const lastOf = (keys) => [...keys.keys()].at(-1);

// A schema without references, and what it may be instead.
function meant(schema) {
  while (schema?.$ref || schema?.allOf?.length === 1) {
    schema = schema.$ref ? definitions[schema.$ref.split("/").at(-1)] : schema.allOf[0];
  }
  return !schema ? [] : schema.anyOf && !schema.properties ? schema.anyOf.flatMap(meant) : [schema];
}

// A mapping's schema; a node's is that of its kind, which its first key says.
const ofMapping = (schema, keys) =>
  schema === definitions.node && keys.size ? definitions[`node-${firstOf(keys)}`] ?? {} : schema;

function below(schemas, frame) {
  return schemas.flatMap((schema) => {
    if (frame.list) return meant(schema.items);
    const { properties = {}, patternProperties = {}, additionalProperties } = ofMapping(schema, frame.keys);
    const [pattern] = Object.values(patternProperties);
    return meant(properties[lastOf(frame.keys)] ?? pattern ?? (additionalProperties || undefined));
  });
}

const schemaAt = (frames) => frames.reduce(below, [first.schema]);
const proposed = (names, type, about = () => "") => names.map((label) => ({ label, type, detail: about(label) }));

// Names that the text declares under a key at its top.
function declared(doc, key) {
  const part = new RegExp(`^${key}:([^\\n]*(?:\\n(?: .*|$))*)`, "m").exec(doc.toString())?.[1] ?? "";
  return [...new Set([...part.matchAll(/(?:^ {1,4}|[{,] *)([a-z]\w*):/gm)].map((found) => found[1]))].filter(
    (name) => !["type", "default", "about"].includes(name),
  );
}

function words(schemas) {
  return schemas.flatMap((schema) => schema.enum ?? (schema.type === "boolean" ? ["true", "false"] : []));
}

function values(doc, frames, schemas) {
  const { keys } = frames.at(-1);
  const [key, kind] = [lastOf(keys), firstOf(keys)];
  const names = { subtree: first.trees, skill: first.skills, monitor: first.skills };
  const found = proposed([...new Set(words(schemas))], "enum");
  if (names[key]) found.push(...proposed(Object.keys(names[key]), "constant", (name) => names[key][name].about));
  if (key === "manipulate") {
    found.push(...Object.entries(first.skills).map(([name, { says }]) => ({ label: says, type: "text", detail: name })));
  }
  if (key === kind && ["test", "set", "condition"].includes(kind)) found.push(...proposed(declared(doc, "blackboard"), "variable"));
  if (definitions[`node-${kind}`]) found.push(...proposed(declared(doc, "parameters").map((name) => `$${name}`), "variable"));
  return found;
}

// A node of a kind with all that it needs, as CodeMirror's snippets are written.
function template(kind, tabs = "") {
  const { properties, required } = definitions[`node-${kind}`];
  const needed = Object.keys(properties).filter((name) => required.includes(name));
  return needed.map((name, i) => {
    if (name === "children") return `${tabs}children:\n${tabs}\t- \${${i + 1}}`;
    if (name === "child") return `${tabs}child:\n${tabs}\t\${${i + 1}}`;
    return `${i ? tabs : ""}${name}: \${${i + 1}:${words(meant(properties[name]))[0] ?? ""}}`;
  }).join("\n");
}

function insertSnippet(view, text, from, to, completion = null) {
  CodeMirror.snippet(text)(view, completion, from, to);
  CodeMirror.startCompletion(view); // of what stands in its first field
}

// Tabs that bring the lines of a node below its first key, behind the dashes of its line.
const tabsTo = (line, column) => "\t".repeat(Math.ceil((column - /^ */.exec(line.text)[0].length) / 2));

function kinds(line, column, dash) {
  return Object.entries(definitions.node.properties).map(([kind, { description }]) => ({
    label: dash + kind,
    type: "class",
    info: description,
    apply: (view, completion, from, to) =>
      insertSnippet(view, dash + template(kind, tabsTo(line, column + dash.length)), from, to, completion),
  }));
}

function keysAt(frames, own, line, column) {
  return schemaAt(frames).flatMap((schema) => {
    if (schema.items === undefined && schema === definitions.node && !own.size) return kinds(line, column, "");
    if (meant(schema.items).includes(definitions.node)) return kinds(line, column, "- ");
    const parameters = lastOf(frames.at(-1)?.keys ?? new Map()) === "arguments" && frames.at(-1).keys.get("subtree");
    const { properties = {} } = ofMapping(schema, own);
    const known = first.trees[parameters]?.parameters ?? Object.keys(properties);
    return known.filter((name) => !own.has(name)).map((name) => ({
      label: name, type: "property", info: properties[name]?.description, apply: `${name}: `,
    }));
  });
}

function complete({ state, pos, explicit }) {
  const line = state.doc.lineAt(pos);
  const outline = Outline.before(state.doc, line.number);
  const { column, rest } = outline.begin(line.text.slice(0, pos - line.from));
  const key = KEY.exec(rest);
  if (key) {
    if (key[2] === undefined || /(^|\s)#/.test(key[2])) return null;
    outline.enter(column, false);
    outline.top.keys.set(key[1], "");
    return { from: pos - key[2].length, options: values(state.doc, outline.frames, schemaAt(outline.frames)), validFor: /^[^#]*$/ };
  }
  const item = column > /^ */.exec(line.text)[0].length; // behind a dash
  if (!/^[\w-]*$/.test(rest) || !(rest || item || explicit)) return null;
  outline.enter(column, false);
  const { frames, top } = outline;
  const options = keysAt(frames.slice(0, -1), top.keys, line, column);
  return { from: pos - rest.length, options, validFor: /^[\w-]*$/ };
}
