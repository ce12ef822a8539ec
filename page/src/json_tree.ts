// Where in a text a JSON pointer (RFC 6901) points to, and which pointer a place has; the text may be unfinished.
import { syntaxTree } from "@codemirror/language";
import type { EditorState, Text } from "@codemirror/state";
import type { SyntaxNode } from "@lezer/common";

export interface Range {
  from: number;
  to: number;
}

export type Path = (string | number)[];

export function pathOf(pointer: string): string[] {
  return pointer.split("/").slice(1).map((word) => word.replaceAll("~1", "/").replaceAll("~0", "~"));
}

export function pointerOf(path: Path): string {
  return path.map((word) => `/${String(word).replaceAll("~", "~0").replaceAll("/", "~1")}`).join("");
}

const VALUES = new Set(["Object", "Array", "String", "Number", "True", "False", "Null"]);

export function valuesIn(node: SyntaxNode): SyntaxNode[] {
  const found: SyntaxNode[] = [];
  for (let child = node.firstChild; child; child = child.nextSibling) if (VALUES.has(child.name)) found.push(child);
  return found;
}

export function nameOf(property: SyntaxNode, text: Text): string {
  const name = property.getChild("PropertyName");
  return name ? read(text.sliceString(name.from, name.to)) : "";
}

function read(literal: string): string {
  try {
    return String(JSON.parse(literal));
  } catch {
    // The closing quotation mark is not there yet.
    return literal.replace(/^"/, "");
  }
}

export function propertyOf(object: SyntaxNode, name: string, text: Text): SyntaxNode | undefined {
  return object.getChildren("Property").find((property) => nameOf(property, text) === name);
}

/** The text of a string that a property of an object has. */
export function wordAt(object: SyntaxNode, name: string, text: Text): string | undefined {
  const value = propertyOf(object, name, text)?.getChild("String");
  return value ? read(text.sliceString(value.from, value.to)) : undefined;
}

/** The value at a pointer; where there is none, the name of the nearest thing around that place. */
export function placeOf(state: EditorState, pointer: string): { range: Range; found: boolean } {
  const text = state.doc;
  let value: SyntaxNode | null = valuesIn(syntaxTree(state).topNode)[0] ?? null;
  let range: Range = { from: 0, to: Math.min(1, text.length) };
  for (const word of pathOf(pointer)) {
    const property = value?.name === "Object" ? propertyOf(value, word, text) : undefined;
    const item = value?.name === "Array" ? valuesIn(value)[Number(word)] : undefined;
    value = property ? (valuesIn(property)[0] ?? null) : (item ?? null);
    const around = property?.getChild("PropertyName") ?? item;
    if (!value || !around) return { range, found: false };
    range = { from: around.from, to: around.to };
  }
  return value ? { range: { from: value.from, to: value.to }, found: true } : { range, found: false };
}

/** The path to what surrounds a node: that of the value which the node is or stands in. */
export function pathTo(node: SyntaxNode, text: Text): Path {
  const path: Path = [];
  for (let at: SyntaxNode = node; at.parent; at = at.parent) {
    const { parent } = at;
    if (parent.name === "Property" && at.name !== "PropertyName") path.unshift(nameOf(parent, text));
    if (parent.name === "Array" && VALUES.has(at.name)) {
      path.unshift(valuesIn(parent).findIndex((item) => item.from === at.from));
    }
  }
  return path;
}
