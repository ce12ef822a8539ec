// What a JSON Schema says of the value at a path. Only what pydantic writes is understood.
import type { Json } from "./types";

export interface Schema {
  $ref?: string;
  anyOf?: Schema[];
  oneOf?: Schema[];
  properties?: Record<string, Schema>;
  additionalProperties?: Schema | boolean;
  items?: Schema;
  required?: string[];
  type?: string;
  const?: Json;
  enum?: Json[];
  default?: Json;
  description?: string;
}

/** A document with schemas in it, and where in it the one of a job document stands. */
export interface Schemas {
  document: unknown;
  start: string;
}

/** `saying(path, name)`: the word that the document has as `name` in the object at a path. */
export type Saying = (path: (string | number)[], name: string) => string | undefined;

/** All schemas that the value at a path may follow, without references and alternatives. */
export function schemasAt(schemas: Schemas, path: (string | number)[], saying: Saying): Schema[] {
  const expand = (schema: Schema, at: (string | number)[]): Schema[] => {
    if (schema.$ref) {
      const { $ref, ...own } = schema;
      return expand({ ...resolved(schemas, $ref), ...own }, at);
    }
    const choices = schema.anyOf ?? schema.oneOf;
    return choices ? choices.flatMap((choice) => expand(choice, at)).filter((choice) => fits(choice, at)) : [schema];
  };
  // One of several shapes is told by a word in it: the kind of a model, the name of a method.
  const fits = (schema: Schema, at: (string | number)[]) =>
    Object.entries(schema.properties ?? {}).every(([name, { const: word }]) => {
      const said = word === undefined ? undefined : saying(at, name);
      // A word that is not there yet does not tell.
      return !said || said === word;
    });
  let found = expand({ $ref: schemas.start }, []);
  for (const [depth, word] of path.entries()) {
    const at = path.slice(0, depth + 1);
    found = found.flatMap((schema) => within(schema, word)).flatMap((schema) => expand(schema, at));
  }
  return found;
}

function within(schema: Schema, word: string | number): Schema[] {
  if (typeof word === "number") return schema.items ? [schema.items] : [];
  const named = schema.properties?.[word];
  if (named) return [named];
  return typeof schema.additionalProperties === "object" ? [schema.additionalProperties] : [];
}

function resolved({ document }: Schemas, reference: string): Schema {
  let at = document as Record<string, unknown>;
  for (const word of reference.split("/").slice(1)) at = at[word] as Record<string, unknown>;
  return at as Schema;
}
