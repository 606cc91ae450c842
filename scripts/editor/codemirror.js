// What the page takes from CodeMirror; the bundle has these names under `CodeMirror`.

export { snippet, startCompletion } from "@codemirror/autocomplete";
export { yaml } from "@codemirror/lang-yaml";
export { syntaxHighlighting } from "@codemirror/language";
export { lintGutter, setDiagnostics } from "@codemirror/lint";
export { Compartment, Transaction } from "@codemirror/state";
export { EditorView } from "@codemirror/view";
export { classHighlighter } from "@lezer/highlight";
export { basicSetup } from "codemirror";
