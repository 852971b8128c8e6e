// The gamepad: what is connected, and what its sticks and buttons do.

import { AXES, BUTTONS, isAxis, learning, padName } from "../driving/pad";
import { mapping, resetMapping, type PadAction } from "../driving/pad_mapping";
import { words } from "../words";

const text = words.pad;

export function PadPanel() {
  return (
    <details class="pad">
      <summary>
        {text.name}: {padName.value ?? text.none}
      </summary>
      <table>
        <tbody>
          {[...AXES, ...BUTTONS].map((action) => (
            <tr key={action}>
              <th scope="row">{text.actions[action]}</th>
              <td>{learning.value === action ? text.waiting : binding(action)}</td>
              <td>
                <button
                  type="button"
                  aria-label={`${text.change}: ${text.actions[action]}`}
                  onClick={() => {
                    learning.value = learning.value === action ? null : action;
                  }}
                >
                  {learning.value === action ? text.cancel : text.change}
                </button>
              </td>
            </tr>
          ))}
        </tbody>
      </table>
      <button type="button" onClick={resetMapping}>
        {text.reset}
      </button>
    </details>
  );
}

function binding(action: PadAction): string {
  if (!isAxis(action)) return text.button(mapping.value.buttons[action]);
  const { axis, sign } = mapping.value.axes[action];
  return text.axis(axis, sign);
}
