// The items of a mission that is drawn: what each has, and new ones.

import { addItem, removeItem, setKey, shiftItem } from "../plans/editor";
import { KINDS, newItem, type Item } from "../plans/mission";
import { words } from "../words";

const text = words.mission;

export function nameOfItem(item: Item, number: number): string {
  const where = typeof item.x_m === "number" ? ` ${item.x_m}, ${String(item.y_m)}` : "";
  const wait = typeof item.duration_s === "number" ? ` ${item.duration_s} s` : "";
  return `${number + 1}  ${String(item.name ?? "")} ${item.kind}${where}${wait}`;
}

export function NewItems() {
  return (
    <select
      aria-label={text.add}
      value=""
      onChange={(event) => {
        addItem(newItem(event.currentTarget.value));
        event.currentTarget.value = "";
      }}
    >
      <option value="">{text.add}</option>
      {Object.keys(KINDS).map((kind) => (
        <option key={kind} value={kind}>
          {kind}
        </option>
      ))}
    </select>
  );
}

export function ItemForm({ item, number, count }: { item: Item; number: number; count: number }) {
  const keys = new Set([...Object.keys(KINDS[item.kind] ?? {}), ...Object.keys(item)]);
  keys.delete("kind");
  return (
    <div class="item-form">
      {[...keys].map((key) => (
        <Field key={key} name={key} value={item[key]} set={(value) => setKey(number, key, value)} />
      ))}
      <div class="row">
        <button type="button" disabled={number === 0} onClick={() => shiftItem(number, -1)}>
          {text.earlier}
        </button>
        <button type="button" disabled={number === count - 1} onClick={() => shiftItem(number, 1)}>
          {text.later}
        </button>
        <button type="button" onClick={() => removeItem(number)}>
          {text.remove}
        </button>
      </div>
    </div>
  );
}

const LETTERS = new Set(["name", "place", "side", "marker"]);

/** One key; what is no plain value is changed on the map, or in the file. */
function Field({ name, value, set }: { name: string; value: unknown; set: (value: unknown) => void }) {
  if (typeof value === "object" && value !== null) return null;
  if (typeof value === "boolean") {
    return (
      <label>
        <input type="checkbox" checked={value} onChange={(event) => set(event.currentTarget.checked)} /> {name}
      </label>
    );
  }
  const isText = LETTERS.has(name) || typeof value === "string";
  return (
    <label>
      {name}
      <input
        type="text"
        inputMode={isText ? "text" : "decimal"}
        value={value === undefined ? "" : String(value)}
        onChange={(event) => {
          const typed = event.currentTarget.value.trim();
          const number = Number(typed);
          set(typed === "" ? undefined : isText || Number.isNaN(number) ? typed : number);
        }}
      />
    </label>
  );
}
