// Entering an API key, where the operator of the service asks for one.
import { useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { key, keyWanted } from "./api";

export function KeyButton() {
  const dialog = useRef<HTMLDialogElement>(null);
  const typed = useSignal("");
  const wanted = keyWanted.value;
  useEffect(() => {
    if (wanted && !dialog.current!.open) dialog.current!.showModal();
  }, [wanted]);
  const take = () => {
    key.value = typed.value.trim();
    typed.value = "";
    keyWanted.value = false;
    dialog.current!.close();
  };
  const forget = () => {
    key.value = "";
    dialog.current!.close();
  };
  return (
    <>
      <button type="button" class="quiet" onClick={() => dialog.current!.showModal()}>
        {key.value ? "Key ✓" : "Key"}
      </button>
      <dialog ref={dialog} aria-labelledby="key-title" onClose={() => { keyWanted.value = false; }}>
        <h2 id="key-title">API key</h2>
        <p>
          {wanted
            ? key.value
              ? "The service does not take this key."
              : "This service asks for a key."
            : "Only needed where the operator of the service has made keys."}{" "}
          It is kept until this tab is closed.
        </p>
        <form method="dialog" onSubmit={(event) => { event.preventDefault(); take(); }}>
          <label>
            Key
            <input type="password" autocomplete="off" value={typed.value} onInput={(event) => { typed.value = event.currentTarget.value; }} />
          </label>
          <div class="buttons">
            <button type="submit" class="primary" disabled={!typed.value.trim()}>Use it</button>
            {key.value && <button type="button" onClick={forget}>Forget it</button>}
            <button type="button" onClick={() => dialog.current!.close()}>Close</button>
          </div>
        </form>
      </dialog>
    </>
  );
}
