// A field of text that narrows a list.

import type { Signal } from "@preact/signals";

interface SearchFieldProps {
  readonly label: string;
  readonly placeholder: string;
  readonly wanted: Signal<string>;
}

export function SearchField({ label, placeholder, wanted }: SearchFieldProps) {
  return (
    <label>
      {label}
      <input
        type="search"
        placeholder={placeholder}
        value={wanted.value}
        onInput={(event) => {
          wanted.value = event.currentTarget.value;
        }}
      />
    </label>
  );
}
