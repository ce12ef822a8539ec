// Starting a job: from a case or an earlier job, edited, checked as one writes, and run.
import { useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { type Fault, getJson, post, Refusal } from "./api";
import type { Editor } from "./editor";
import { seconds } from "./format";
import { useLoaded } from "./load";
import { Action, Trouble } from "./parts";
import { go, route, to } from "./route";
import { pretty } from "./snippets";
import { SweepForm } from "./sweep_form";
import type { Case, Job, Json, Method } from "./types";

interface Size {
  method: string;
  variables: number;
  constraints: number;
  nodes: number;
  seconds: number;
}

type Verdict = { size: Size } | { faults: Fault[] } | { error: Error } | null;

const FIRST = "flexible_spacecraft";

/** What the form is filled with: the cases, the methods, and the document of a case or of an earlier job. */
interface Shelf {
  cases: Case[];
  methods: Method[];
  named: string;
  from: string | null;
  start: Json;
}

async function shelf(query: URLSearchParams, signal: AbortSignal): Promise<Shelf> {
  const from = query.get("from");
  const named = from ? "" : (query.get("case") ?? FIRST);
  const path = from ? `/v1/jobs/${encodeURIComponent(from)}/spec` : `/v1/cases/${encodeURIComponent(named)}`;
  const [{ cases }, { methods }, start] = await Promise.all([
    getJson<{ cases: Case[] }>("/v1/cases", signal),
    getJson<{ methods: Method[] }>("/v1/methods", signal),
    getJson<Json>(path, signal),
  ]);
  return { cases, methods, named, from, start };
}

export function NewJob() {
  const { query } = route.value;
  const { data, error } = useLoaded((signal) => shelf(query, signal), [query.toString()]);
  return (
    <>
      <h1 tabIndex={-1}>New job</h1>
      <Trouble error={error.value} />
      {/* Another form for another document, once that is there. */}
      {data.value && <Form key={data.value.from ?? data.value.named} {...data.value} />}
    </>
  );
}

function Form({ cases, methods, named, from, start }: Shelf) {
  const editor = useRef<Editor | null>(null);
  const verdict = useSignal<Verdict>(null);
  const check = async (text: string): Promise<Fault[]> => {
    try {
      verdict.value = { size: await post<Size>("/v1/validate", text) };
      return [];
    } catch (reason) {
      if (!(reason instanceof Refusal) || reason.faults.length === 0) {
        verdict.value = { error: reason as Error };
        return [];
      }
      verdict.value = { faults: reason.faults };
      return reason.faults;
    }
  };
  const put = (name: string, value: Json) => {
    const { current } = editor;
    if (!current || current.replace(`/${name}`, JSON.stringify(value))) return;
    current.set(pretty({ ...JSON.parse(current.text()), [name]: value }));
  };
  const run = async () => {
    const job = await post<Job>("/v1/jobs", editor.current!.text());
    go(to(`/jobs/${job.id}`));
  };
  const choose = (event: Event) => {
    const method = methods.find(({ name }) => name === (event.currentTarget as HTMLSelectElement).value);
    if (method) put("method", { name: method.name, ...method.defaults } as Json);
  };
  const { value } = verdict;
  const good = value !== null && "size" in value;
  // A text that is not JSON can only be changed by hand.
  const broken = value === null || "error" in value;
  return (
    <>
      <div class="filters">
        <label class="wide">
          Case
          <select name="case" value={named} onChange={(event) => go(to("/new", { case: event.currentTarget.value }))}>
            {from && <option value="">the document of an earlier job</option>}
            {cases.map(({ name, title }) => <option key={name} value={name}>{title}</option>)}
          </select>
        </label>
        <label>
          Method
          <select name="method" value={good ? value.size.method : ""} onChange={choose} disabled={broken}>
            {!good && <option value="">–</option>}
            {methods.map(({ name, title }) => <option key={name} value={name}>{title}</option>)}
          </select>
        </label>
        {from && (
          <label class="check">
            <input type="checkbox" disabled={broken} onChange={(event) => put("warm_start", event.currentTarget.checked ? from : null)} />
            start from its answer
          </label>
        )}
      </div>
      <EditorBox text={pretty(start)} editor={editor} check={check} broken={(reason) => { verdict.value = { error: new Error(reason) }; }} />
      <Findings verdict={value} show={(pointer) => editor.current?.show(pointer)} />
      <div class="buttons">
        <Action kind="primary" act={run} disabled={!good}>Run</Action>
      </div>
      {good && <SweepForm document={() => JSON.parse(editor.current!.text())} />}
    </>
  );
}

function EditorBox(props: { text: string; editor: { current: Editor | null }; check: (text: string) => Promise<Fault[]>; broken: (reason: string) => void }) {
  const host = useRef<HTMLDivElement>(null);
  const error = useSignal<Error | null>(null);
  useEffect(() => {
    let gone = false;
    Promise.all([import("./editor.js"), getJson<unknown>("/openapi.json")]).then(
      ([{ createEditor }, document]) => {
        if (gone || !host.current) return;
        const schemas = { document, start: "#/components/schemas/JobDocument" };
        const { check, broken } = props;
        props.editor.current = createEditor(host.current, props.text, { label: "Job document", schemas, check, broken });
      },
      (reason: Error) => { error.value = reason; },
    );
    return () => {
      gone = true;
      props.editor.current?.destroy();
      props.editor.current = null;
    };
  }, []);
  return (
    <>
      <Trouble error={error.value} />
      <div class="editor" ref={host} />
    </>
  );
}

/** What the service says of the document; a mistake that is clicked is shown in the editor. */
function Findings({ verdict, show }: { verdict: Verdict; show: (pointer: string) => void }) {
  return (
    <div class="findings" role="status">
      {verdict === null && <p class="muted">Checking …</p>}
      {verdict && "error" in verdict && <p class="bad">✕ {verdict.error.message}</p>}
      {verdict && "size" in verdict && (
        <p>
          <span class="good">✓ valid</span>: {verdict.size.variables} variables, {verdict.size.constraints} constraints,{" "}
          {verdict.size.nodes} nodes; about {seconds(verdict.size.seconds)}
        </p>
      )}
      {verdict && "faults" in verdict && (
        <>
          <p class="bad">✕ {verdict.faults.length === 1 ? "one mistake" : `${verdict.faults.length} mistakes`}</p>
          <ul>
            {verdict.faults.map(({ pointer = "", detail }) => (
              <li key={pointer + detail}>
                <button type="button" class="quiet" onClick={() => show(pointer)}><code>{pointer || "/"}</code></button> {detail}
              </li>
            ))}
          </ul>
        </>
      )}
    </div>
  );
}
