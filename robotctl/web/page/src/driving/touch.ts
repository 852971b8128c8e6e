// Driving by a joystick on the screen: a finger on it is the dead-man key.

import { RELEASED, type Deflection, type Reading } from "./source";

/** Shares of the deflection that the joysticks on the screen have now; null: nobody touches one. */
export class Touch {
  private readonly sticks = new Map<string, Partial<Deflection>>();

  move(stick: string, deflection: Partial<Deflection>): void {
    this.sticks.set(stick, deflection);
  }

  release(stick: string): void {
    this.sticks.delete(stick);
  }

  letGo(): void {
    this.sticks.clear();
  }

  read(nowMs: number): Reading {
    return Object.assign({ held: this.sticks.size > 0, sampledMs: nowMs }, RELEASED, ...this.sticks.values()) as Reading;
  }
}
