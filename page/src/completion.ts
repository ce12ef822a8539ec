// What may stand where the cursor is, from the JSON Schema of job documents; and what it means.
import type { Completion, CompletionContext, CompletionResult } from "@codemirror/autocomplete";
import { syntaxTree } from "@codemirror/language";
import type { EditorState, Text } from "@codemirror/state";
import { hoverTooltip } from "@codemirror/view";
import type { SyntaxNode } from "@lezer/common";
import { nameOf, type Path, pathTo, placeOf, pointerOf, wordAt } from "./json_tree";
import { type Saying, type Schema, type Schemas, schemasAt } from "./schema";

export function completeFrom(schemas: Schemas) {
  return (context: CompletionContext): CompletionResult | null => {
    const { state, pos } = context;
    const text = state.doc;
    const node = syntaxTree(state).resolveInner(pos, -1);
    const word = context.matchBefore(/"?[\w$*]*/);
    const from = word?.from ?? pos;
    if (from === pos && !context.explicit) return null;
    const look = (path: Path) => schemasAt(schemas, path, sayingIn(state));
    const end = text.sliceString(pos, pos + 1) === '"' ? pos + 1 : pos;
    const options = namesWanted(node, text, from)
      ? names(look(pathTo(node, text)), present(node, text, from))
      : values(look(valuePath(node, text)));
    return options.length === 0 ? null : { from, to: end, options, validFor: /^"?[\w$*]*$/ };
  };
}

/** True where a name of an object is to come, false where a value is. */
function namesWanted(node: SyntaxNode, text: Text, from: number): boolean {
  const before = text.sliceString(Math.max(0, from - 200), from).trimEnd().slice(-1);
  return before === "{" || (before === "," && objectAround(node)?.name === "Object");
}

function objectAround(node: SyntaxNode): SyntaxNode | null {
  for (let at: SyntaxNode | null = node; at; at = at.parent) if (at.name === "Object" || at.name === "Array") return at;
  return null;
}

/** The path of the value that is to come: that of a property whose value is not there yet is its name's. */
function valuePath(node: SyntaxNode, text: Text): Path {
  for (let at: SyntaxNode | null = node; at && at.name !== "Object"; at = at.parent) {
    if (at.name === "Property") return [...pathTo(at, text), nameOf(at, text)];
    if (at.name === "Array") return [...pathTo(at, text), 0];
  }
  return pathTo(node, text);
}

/** The names that the object has already, but for the one that is being written. */
function present(node: SyntaxNode, text: Text, from: number): Set<string> {
  const properties = objectAround(node)?.getChildren("Property") ?? [];
  return new Set(properties.filter((property) => property.from !== from).map((property) => nameOf(property, text)));
}

function sayingIn(state: EditorState): Saying {
  return (path, name) => {
    const { range, found } = placeOf(state, pointerOf(path));
    const node = found ? syntaxTree(state).resolveInner(range.from, 1) : null;
    const object = node?.name === "{" ? node.parent : node;
    return object?.name === "Object" ? wordAt(object, name, state.doc) : undefined;
  };
}

function names(schemas: Schema[], present: Set<string>): Completion[] {
  const found = new Map<string, Completion>();
  for (const schema of schemas) {
    for (const [name, property] of Object.entries(schema.properties ?? {})) {
      if (present.has(name) || found.has(name)) continue;
      const required = schema.required?.includes(name) ?? false;
      found.set(name, {
        label: `"${name}"`,
        displayLabel: name,
        apply: `"${name}": `,
        type: "property",
        detail: required ? "required" : shapeOf(property),
        info: property.description,
        boost: required ? 10 : 0,
      });
    }
  }
  return [...found.values()];
}

function values(schemas: Schema[]): Completion[] {
  const found = new Set<string>();
  for (const { const: only, enum: some, type, default: usual } of schemas) {
    const listed = [only, ...(some ?? []), usual].filter((value) => value !== undefined);
    if (type === "boolean") listed.push(true, false);
    if (type === "null") listed.push(null);
    for (const value of listed) if (value === null || typeof value !== "object") found.add(JSON.stringify(value));
  }
  return [...found].map((label) => ({ label, type: "constant" }));
}

function shapeOf({ type, anyOf, enum: some }: Schema): string {
  if (some) return some.map(String).join(" | ");
  return type ?? anyOf?.map((choice) => choice.type ?? "").filter(Boolean).join(" | ") ?? "";
}

/** What a name means, for whoever points at it. */
export function explainFrom(schemas: Schemas) {
  return hoverTooltip((view, pos) => {
    const node = syntaxTree(view.state).resolveInner(pos);
    if (node.name !== "PropertyName" || !node.parent) return null;
    const path = [...pathTo(node.parent, view.state.doc), nameOf(node.parent, view.state.doc)];
    const words = schemasAt(schemas, path, sayingIn(view.state)).find(({ description }) => description)?.description;
    if (!words) return null;
    const create = () => {
      const dom = document.createElement("div");
      dom.className = "cm-explained";
      dom.textContent = words;
      return { dom };
    };
    return { pos: node.from, end: node.to, above: true, create };
  });
}
