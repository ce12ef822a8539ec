// A job document as something to run elsewhere; flights, of the job `flown`.
import stringify from "json-stringify-pretty-compact";
import type { Json } from "./types";

export function pretty(document: Json): string {
  return stringify(document, { maxLength: 100 });
}

/** A command for a POSIX shell. The text stands behind it as it is: in JSON, no line is END. */
export function asCurl(document: Json, origin: string, keyed: boolean, flown: string | null): string {
  const path = flown ? `/v1/jobs/${flown}/flights` : "/v1/jobs";
  const key = keyed ? ` -H "Authorization: Bearer $ONDELETTE_KEY"` : "";
  const headers = `-H 'Content-Type: application/json' -H 'Prefer: wait=60'${key}`;
  return `curl -sS ${origin}${path} ${headers} -d @- <<'END'\n${pretty(document)}\nEND\n`;
}

export function asPython(document: Json, origin: string, keyed: boolean, flown: string | null): string {
  const call = flown ? `flights("${flown}", document)` : "solve(document)";
  const key = keyed ? `, key=os.environ["ONDELETTE_KEY"]` : "";
  return `${keyed ? "import os\n\n" : ""}from app.client import Client

document = ${literal(document)}

with Client("${origin}"${key}) as client:
    result = client.${call}
    print(result["success"], result["objective"])
`;
}

/** A JSON value as a literal of Python. Its strings are JSON's: Python reads the same escapes. */
function literal(value: Json, indent = ""): string {
  if (value === null) return "None";
  if (value === true) return "True";
  if (value === false) return "False";
  if (typeof value !== "object") return JSON.stringify(value);
  const deeper = `${indent}    `;
  const list = Array.isArray(value);
  const items = list
    ? value.map((item) => literal(item, deeper))
    : Object.entries(value).map(([name, item]) => `${JSON.stringify(name)}: ${literal(item, deeper)}`);
  const [open, close] = list ? "[]" : "{}";
  const short = `${open}${items.join(", ")}${close}`;
  if (short.length + indent.length <= 88 && !short.includes("\n")) return short;
  return `${open}\n${items.map((item) => `${deeper}${item},\n`).join("")}${indent}${close}`;
}
