// Small parts that several views use.
import { useSignal } from "@preact/signals";
import type { ComponentChildren } from "preact";
import { Refusal } from "./api";

const SIGNS: Record<string, string> = { queued: "○", running: "◐", succeeded: "●", failed: "✕", cancelled: "◌" };

/** A status as a word with a sign and a colour, so that none of them is needed alone. */
export function Status({ status }: { status: string }) {
  return (
    <span class={`status status-${status}`}>
      <span aria-hidden="true">{SIGNS[status] ?? "·"}</span> {status}
    </span>
  );
}

/** Why something did not work, in the service's own words. */
export function Trouble({ error }: { error: Error | null }) {
  if (error === null) return null;
  const faults = error instanceof Refusal ? error.faults : [];
  return (
    <div class="trouble" role="alert">
      <p>{error.message}</p>
      {faults.length > 0 && (
        <ul>
          {faults.map((fault) => (
            <li key={fault.pointer ?? fault.parameter}>
              <code>{fault.pointer ?? fault.parameter}</code> {fault.detail}
            </li>
          ))}
        </ul>
      )}
    </div>
  );
}

/** A table that scrolls sideways where it is wider than the page, by keyboard as well. */
export function WideTable({ label, kind, children }: { label: string; kind?: string; children: ComponentChildren }) {
  return (
    <div class="scroll" tabIndex={0} role="region" aria-label={label}>
      <table class={kind}>{children}</table>
    </div>
  );
}

/** A button that does something of the service's, is off meanwhile, and says if it was refused. */
export function Action(props: { children: ComponentChildren; act: () => Promise<void>; kind?: string; disabled?: boolean }) {
  const busy = useSignal(false);
  const error = useSignal<Error | null>(null);
  const act = async () => {
    busy.value = true;
    error.value = null;
    try {
      await props.act();
    } catch (reason) {
      error.value = reason as Error;
    } finally {
      busy.value = false;
    }
  };
  return (
    <>
      <button type="button" class={props.kind} onClick={act} disabled={busy.value || props.disabled}>
        {props.children}
      </button>
      <Trouble error={error.value} />
    </>
  );
}

/** Text to be copied; where the browser does not let a page copy (plain http), it is selected instead. */
export function Copied({ text, label }: { text: string; label: string }) {
  const said = useSignal("");
  const copy = async (event: MouseEvent) => {
    const block = (event.currentTarget as Element).closest(".copied")?.querySelector("pre");
    try {
      await navigator.clipboard.writeText(text);
      said.value = "copied";
    } catch {
      if (block) getSelection()?.selectAllChildren(block);
      said.value = "selected; copy it with the keyboard";
    }
  };
  return (
    <div class="copied">
      <div class="copied-head">
        <span>{label}</span>
        <span role="status">{said.value}</span>
        <button type="button" onClick={copy} aria-label={`Copy: ${label}`}>Copy</button>
      </div>
      <pre tabIndex={0}>{text}</pre>
    </div>
  );
}

export function Section(props: { title: string; id: string; children: ComponentChildren; aside?: ComponentChildren }) {
  return (
    <section aria-labelledby={props.id} class="section">
      <div class="section-head">
        <h2 id={props.id}>{props.title}</h2>
        {props.aside}
      </div>
      {props.children}
    </section>
  );
}

export type Fact = [string, ComponentChildren];

/** Names and values: a list, or a `strip` across the page. */
export function Facts({ facts, strip }: { facts: Fact[]; strip?: boolean }) {
  return (
    <dl class={strip ? "strip" : "facts"}>
      {facts.map(([name, value]) => (
        <div key={name}>
          <dt>{name}</dt>
          <dd>{value}</dd>
        </div>
      ))}
    </dl>
  );
}
