// The editor of job documents; a file of its own, for only those who start a job need it.
import { autocompletion } from "@codemirror/autocomplete";
import { json, jsonParseLinter } from "@codemirror/lang-json";
import { HighlightStyle, syntaxHighlighting } from "@codemirror/language";
import { type Diagnostic, linter, lintGutter } from "@codemirror/lint";
import { EditorView } from "@codemirror/view";
import { tags } from "@lezer/highlight";
import { basicSetup } from "codemirror";
import type { Fault } from "./api";
import { completeFrom, explainFrom } from "./completion";
import { placeOf } from "./json_tree";
import type { Schemas } from "./schema";

export interface Options {
  label: string;
  schemas: Schemas;
  /** Says what is wrong with a text that is JSON. */
  check(text: string): Promise<Fault[]>;
  /** Told of a text that is not JSON. */
  broken(reason: string): void;
}

export interface Editor {
  text(): string;
  set(text: string): void;
  /** Put JSON in the place of the value at a pointer; false if there is none. */
  replace(pointer: string, text: string): boolean;
  /** Go to what a pointer points to. */
  show(pointer: string): void;
  destroy(): void;
}

const COLOURS = HighlightStyle.define([
  { tag: tags.propertyName, color: "var(--accent)" },
  { tag: tags.string, color: "var(--ink)" },
  { tag: [tags.number, tags.bool, tags.null], color: "var(--figure)" },
  { tag: [tags.punctuation, tags.separator], color: "var(--muted)" },
]);

const LOOKS = EditorView.theme({
  "&": { backgroundColor: "var(--surface)", color: "var(--ink)", height: "100%", fontSize: "13px" },
  ".cm-scroller": { fontFamily: "var(--mono)", lineHeight: "1.45" },
  ".cm-content": { caretColor: "var(--ink)" },
  ".cm-cursor": { borderLeftColor: "var(--ink)" },
  ".cm-gutters": { backgroundColor: "var(--surface)", color: "var(--muted)", borderRight: "1px solid var(--line)" },
  ".cm-activeLine, .cm-activeLineGutter": { backgroundColor: "var(--hover)" },
  "&.cm-focused > .cm-scroller > .cm-selectionLayer .cm-selectionBackground, .cm-selectionBackground": {
    backgroundColor: "var(--selection)",
  },
  ".cm-selectionMatch, &.cm-focused .cm-matchingBracket": { backgroundColor: "var(--selection)" },
  ".cm-foldPlaceholder": { backgroundColor: "var(--hover)", color: "var(--ink)", borderColor: "var(--line)" },
  ".cm-tooltip, .cm-panels": { backgroundColor: "var(--ground)", color: "var(--ink)", border: "1px solid var(--line)" },
  ".cm-tooltip .cm-explained": { padding: "4px 8px", maxWidth: "26rem" },
  ".cm-tooltip-autocomplete > ul > li[aria-selected]": { backgroundColor: "var(--accent)", color: "var(--ground)" },
  ".cm-tooltip.cm-completionInfo": { maxWidth: "22rem" },
  ".cm-completionDetail": { color: "inherit" },
  ".cm-diagnostic-error": { borderLeftColor: "var(--bad)" },
});

/** Make an editor in an element. It lives in a shadow root, where styles need no exception from the policy. */
export function createEditor(host: HTMLElement, text: string, options: Options): Editor {
  const root = host.shadowRoot ?? host.attachShadow({ mode: "open" });
  const syntax = jsonParseLinter();
  const faults = async (view: EditorView): Promise<Diagnostic[]> => {
    const mistakes = syntax(view);
    if (mistakes.length > 0) {
      options.broken(mistakes[0]!.message);
      return mistakes;
    }
    const found = await options.check(view.state.doc.toString());
    return found.map(({ pointer = "", detail }) => ({ ...placeOf(view.state, pointer).range, severity: "error", message: detail }));
  };
  const view = new EditorView({
    doc: text,
    root,
    parent: root,
    extensions: [
      basicSetup,
      autocompletion({ icons: false }),
      json(),
      json().language.data.of({ autocomplete: completeFrom(options.schemas) }),
      explainFrom(options.schemas),
      linter(faults, { delay: 300 }),
      lintGutter(),
      syntaxHighlighting(COLOURS),
      LOOKS,
      EditorView.lineWrapping,
      EditorView.contentAttributes.of({ "aria-label": options.label, tabindex: "0" }),
    ],
  });
  return {
    text: () => view.state.doc.toString(),
    set: (text) => view.dispatch({ changes: { from: 0, to: view.state.doc.length, insert: text } }),
    replace: (pointer, text) => {
      const { range, found } = placeOf(view.state, pointer);
      if (found) view.dispatch({ changes: { ...range, insert: text } });
      return found;
    },
    show: (pointer) => {
      const { range } = placeOf(view.state, pointer);
      view.dispatch({ selection: { anchor: range.from, head: range.to }, scrollIntoView: true });
      view.focus();
    },
    destroy: () => view.destroy(),
  };
}
