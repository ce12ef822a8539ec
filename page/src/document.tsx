// The document of a job as it was submitted, to be read, copied, and run elsewhere.
import { useSignal } from "@preact/signals";
import { getJson, key } from "./api";
import { useLoaded } from "./load";
import { Copied, Section, Trouble } from "./parts";
import { asCurl, asPython, pretty } from "./snippets";
import type { Job, Json } from "./types";

const FORMS = {
  JSON: pretty,
  curl: (document: Json, flown: string | null) => asCurl(document, location.origin, Boolean(key.value), flown),
  Python: (document: Json, flown: string | null) => asPython(document, location.origin, Boolean(key.value), flown),
};
type Form = keyof typeof FORMS;

export function Submitted({ job: { id, flights_of: flown } }: { job: Job }) {
  const form = useSignal<Form>("JSON");
  const { data, error } = useLoaded((signal) => getJson<Json>(`/v1/jobs/${id}/spec`, signal), [id]);
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
      {data.value !== null && <Copied text={FORMS[form.value](data.value, flown)} label={`as submitted, ${form.value}`} />}
    </Section>
  );
}
