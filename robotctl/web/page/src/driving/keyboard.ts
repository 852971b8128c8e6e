// Driving by keys: Shift is the dead-man key, arrows or WASD are the sticks, Q and E move sideways.

import type { Reading } from "./source";

const FORWARD = ["ArrowUp", "KeyW"];
const BACKWARD = ["ArrowDown", "KeyS"];
const LEFT = ["ArrowLeft", "KeyA"];
const RIGHT = ["ArrowRight", "KeyD"];
const SIDEWAYS_LEFT = ["KeyQ"];
const SIDEWAYS_RIGHT = ["KeyE"];
const STICKS = new Set([...FORWARD, ...BACKWARD, ...LEFT, ...RIGHT, ...SIDEWAYS_LEFT, ...SIDEWAYS_RIGHT]);

/** Whether keys go into a field of text. */
export function isTyping(target: EventTarget | null): boolean {
  return target instanceof HTMLInputElement && (target.type === "search" || target.type === "text");
}

export class Keyboard {
  private held = false;
  private readonly pressed = new Set<string>();

  listen(): void {
    addEventListener("keydown", (event) => this.down(event));
    addEventListener("keyup", (event) => this.up(event));
  }

  /** Forget all keys: what happens to them while others have the focus is not told. */
  letGo(): void {
    this.held = false;
    this.pressed.clear();
  }

  read(nowMs: number): Reading {
    return {
      held: this.held,
      sampledMs: nowMs,
      forward: this.any(FORWARD) - this.any(BACKWARD),
      turn: this.any(LEFT) - this.any(RIGHT),
      sideways: this.any(SIDEWAYS_LEFT) - this.any(SIDEWAYS_RIGHT),
    };
  }

  private any(codes: readonly string[]): number {
    return codes.some((code) => this.pressed.has(code)) ? 1 : 0;
  }

  private down(event: KeyboardEvent): void {
    if (isTyping(event.target) || event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.key === "Shift" && !event.repeat) this.held = true;
    if (!STICKS.has(event.code)) return;
    this.pressed.add(event.code);
    if (this.held) event.preventDefault(); // else the arrows scroll the page
  }

  private up(event: KeyboardEvent): void {
    if (event.key === "Shift") this.held = false;
    this.pressed.delete(event.code);
  }
}
