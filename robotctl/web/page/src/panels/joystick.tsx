// Joysticks on the screen, for fingers and mice.

import { useRef } from "preact/hooks";
import { useSignal } from "@preact/signals";

import { isBlind, touch } from "../driving/driving";
import type { Deflection } from "../driving/source";
import { hello } from "../robot/robot";
import { words } from "../words";

const text = words.drive;
/** Share of the joystick's size that its knob moves. */
const TRAVEL = 0.36;

export function Joysticks() {
  const isHolonomic = hello.value?.holonomic === true;
  return (
    <div class="joysticks">
      <Joystick
        name="move"
        label={text.stick}
        deflect={(right, up) =>
          isHolonomic ? { forward: up, sideways: -right } : { forward: up, turn: -right }
        }
      />
      {isHolonomic && <Joystick name="turn" label={text.turnStick} deflect={(right) => ({ turn: -right })} />}
    </div>
  );
}

interface Props {
  readonly name: string;
  readonly label: string;
  /** What shares of the way to the right and up mean. */
  readonly deflect: (right: number, up: number) => Partial<Deflection>;
}

function Joystick({ name, label, deflect }: Props) {
  const base = useRef<HTMLDivElement>(null);
  const knob = useSignal<readonly [number, number] | null>(null);

  const move = (event: PointerEvent) => {
    const box = (base.current as HTMLDivElement).getBoundingClientRect();
    const radius = TRAVEL * box.width;
    const right = (event.clientX - box.left - box.width / 2) / radius;
    const up = -(event.clientY - box.top - box.height / 2) / radius;
    const length = Math.max(1, Math.hypot(right, up));
    knob.value = [right / length, up / length];
    touch.move(name, deflect(right / length, up / length));
  };
  const release = () => {
    knob.value = null;
    touch.release(name);
  };
  const [right, up] = knob.value ?? [0, 0];
  return (
    <div
      ref={base}
      class={knob.value === null ? "joystick" : "joystick held"}
      role="img"
      aria-label={label}
      aria-disabled={isBlind.value}
      onPointerDown={(event) => {
        event.currentTarget.setPointerCapture(event.pointerId);
        move(event);
      }}
      onPointerMove={(event) => {
        if (knob.value !== null) move(event);
      }}
      onPointerUp={release}
      onPointerCancel={release}
      onLostPointerCapture={release}
    >
      <div
        class="knob"
        style={{ left: `${50 + 100 * TRAVEL * right}%`, top: `${50 - 100 * TRAVEL * up}%` }}
      />
    </div>
  );
}
