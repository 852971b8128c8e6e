// What was asked for on this page and came to nothing.

import { refusal } from "../wire/live";
import { words } from "../words";

const text = words.refusals;

export function RefusalToast() {
  const last = refusal.value;
  return (
    <div class="toast" role="alert">
      {last !== null && (
        <p>
          {text.title(last.what, last.reason || text.unsent)}
          <button
            type="button"
            aria-label={text.close}
            onClick={() => {
              refusal.value = null;
            }}
          >
            ×
          </button>
        </p>
      )}
    </div>
  );
}
