// The document of a job as it was submitted, to be read, copied, and run elsewhere.
import { useSignal } from "@preact/signals";
import { getJson, key } from "./api";
import { useLoaded } from "./load";
import { Copied, Section, Trouble } from "./parts";
import { asCurl, asPython, pretty } from "./snippets";
import type { Json } from "./types";

const FORMS = {
  JSON: pretty,
  curl: (document: Json) => asCurl(document, location.origin, Boolean(key.value)),
  Python: (document: Json) => asPython(document, location.origin, Boolean(key.value)),
};
type Form = keyof typeof FORMS;

export function Submitted({ job }: { job: string }) {
  const form = useSignal<Form>("JSON");
  const { data, error } = useLoaded((signal) => getJson<Json>(`/v1/jobs/${job}/spec`, signal), [job]);
  const choice = (
    <div class="choice" role="group" aria-label="Document as">
      {(Object.keys(FORMS) as Form[]).map((name) => (
        <button key={name} type="button" aria-pressed={form.value === name} onClick={() => { form.value = name; }}>
          {name}
        </button>
      ))}
    </div>
  );
  return (
    <Section title="Document" id="document" aside={choice}>
      <Trouble error={error.value} />
      {data.value !== null && <Copied text={FORMS[form.value](data.value)} label={`as submitted, ${form.value}`} />}
    </Section>
  );
}
