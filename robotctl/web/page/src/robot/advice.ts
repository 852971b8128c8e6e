// Why the robot does not drive, and what to do about it.

import {
  FaultCode,
  Mode,
  SafetyState,
  type ControlState,
  type Fault,
  type NavigationState,
} from "../wire/messages";
import { nameOf } from "../wire/names";
import { words } from "../words";

export interface Advice {
  readonly what: string;
  readonly remedy: string;
}

/** What keeps the robot from driving, the first thing first; empty while it drives or could. */
export function advise(control: ControlState, navigation: NavigationState | null): readonly Advice[] {
  const { state, reason, fault, against_arming } = control;
  const why = words.why;
  switch (state) {
    case SafetyState.FAULT:
    case SafetyState.EMERGENCY_STOP:
      return [{ what: reason, remedy: remedyOf(fault) || why.armAgain }, ...objections(against_arming, reason)];
    case SafetyState.BOOT:
    case SafetyState.STANDBY: {
      const found = objections(against_arming, "");
      return found.length > 0 ? found : [{ what: reason || why.standby, remedy: why.standbyRemedy }];
    }
    default:
      return navigation === null ? [] : held(navigation);
  }
}

function objections(faults: readonly Fault[], said: string): Advice[] {
  return faults
    .filter((fault) => fault.text !== said)
    .map((fault) => ({ what: fault.text, remedy: remedyOf(fault.code) || words.why.seeNotices }));
}

function held({ mode, message }: NavigationState): readonly Advice[] {
  if (mode === Mode.HOLD) return [{ what: message || words.why.hold, remedy: words.why.holdRemedy }];
  return message === "" ? [] : [{ what: message, remedy: "" }];
}

function remedyOf(code: FaultCode): string {
  return words.remedies[nameOf(FaultCode, code) ?? "NONE"] ?? "";
}
