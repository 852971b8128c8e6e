// One parameter: its value, which Enter sets, and what is to be known of it.

import { useSignal } from "@preact/signals";

import { isBlind, mayDrive } from "../driving/driving";
import { shown, type Parameter } from "../robot/parameters";
import { ask, refusal } from "../wire/live";
import { words } from "../words";

const text = words.tune;

/** Ask for a value of a parameter; null: that of the robot's file. */
export function set(name: string, value: number | null): void {
  ask(name, { type: "TuneRequest", name, value });
}

export function ParameterRow({ parameter }: { readonly parameter: Parameter }) {
  const { name, key, unit, description, wanted, inForce, standard, is_fixed } = parameter;
  /** What was typed and not set yet; null: nothing. */
  const draft = useSignal<string | null>(null);
  const isLocked = is_fixed || !mayDrive.value || isBlind.value;
  const value = draft.value ?? shown(wanted);
  const typed = () => draft.peek() ?? shown(wanted); // the next key may come before the next frame
  const give = () => {
    const value = typed();
    const number = Number(value.replace(",", "."));
    if (value.trim() === "" || !Number.isFinite(number)) {
      refusal.value = { what: name, reason: text.notANumber(value) };
    } else {
      draft.value = null;
      set(name, number);
    }
  };
  const onKeyDown = (event: KeyboardEvent) => {
    const steps = { ArrowUp: 1, ArrowDown: -1, PageUp: 10, PageDown: -10 }[event.key];
    if (event.key === "Enter") give();
    else if (event.key === "Escape") draft.value = null;
    else if (steps !== undefined && !event.shiftKey && !isLocked) draft.value = stepped(parameter, Number(typed()), steps);
    else return;
    event.preventDefault();
  };
  return (
    <li class={wanted === standard ? "parameter" : "parameter changed"}>
      <label for={`p-${name}`}>
        <b>{key.slice(key.lastIndexOf(".") + 1)}</b> <small>{name}</small>
      </label>
      <div class="row">
        <input
          id={`p-${name}`}
          type="text"
          inputMode="decimal"
          autocomplete="off"
          readOnly={isLocked}
          aria-describedby={`d-${name}`}
          class={draft.value === null ? "" : "draft"}
          value={value}
          onInput={(event) => {
            draft.value = event.currentTarget.value;
          }}
          onKeyDown={onKeyDown}
        />
        {unit !== "" && <span>{unit}</span>}
        {draft.value !== null && (
          <button type="button" class="primary" aria-label={text.setThis(name)} onClick={give}>
            {text.set}
          </button>
        )}
        {wanted !== standard && (
          <button
            type="button"
            disabled={isLocked}
            aria-label={text.backThis(name, shown(standard))}
            onClick={() => {
              draft.value = null;
              set(name, null);
            }}
          >
            {text.back(shown(standard))}
          </button>
        )}
        {wanted !== inForce && <span class="waits">{text.waits(shown(inForce))}</span>}
      </div>
      <p class="hint" id={`d-${name}`}>
        {description} {text.range(shown(parameter.low), shown(parameter.high), unit)}. {text.takesEffect(parameter.change)}
      </p>
    </li>
  );
}

/** A value some steps further, each one of the second digit of the present value in force. */
function stepped({ wanted, low, high, is_whole }: Parameter, from: number, steps: number): string {
  const base = Math.abs(wanted) || (high - low) / 100;
  const size = Math.max(10 ** (Math.floor(Math.log10(base)) - 1), is_whole ? 1 : 0);
  return shown(Math.min(Math.max((Number.isFinite(from) ? from : wanted) + steps * size, low), high));
}
