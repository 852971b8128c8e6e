// Why the robot does not drive, and what to do about it.

import { now } from "../robot/clock";
import { advise, type Advice } from "../robot/advice";
import { topics } from "../robot/robot";
import { isReplay } from "../replay/mode";
import { access } from "../wire/access";
import { live } from "../wire/live";
import { SafetyState } from "../wire/messages";
import { words } from "../words";

const text = words.why;

interface Finding {
  readonly kind: "good" | "wait" | "bad";
  readonly advice: readonly Advice[];
}

export function Why() {
  const { kind, advice } = find();
  if (isReplay && !live.isOpen.value) return <p class="why why-bad">{words.replay.ended}</p>;
  return (
    <section class={`why why-${kind}`} aria-label={text.name} aria-live={kind === "good" ? "off" : "polite"}>
      <ul>
        {advice.map(({ what, remedy }) => (
          <li key={what}>
            <span class="what">{sentence(what)}</span> <span class="remedy">{isReplay ? "" : remedy}</span>
          </li>
        ))}
      </ul>
    </section>
  );
}

function find(): Finding {
  const control = topics.ControlState.newest.value;
  if (!live.isOpen.value) return unlinked();
  if (control === null) return { kind: "wait", advice: [{ what: text.noControl, remedy: text.noControlRemedy }] };
  if (topics.ControlState.isStale(now.value)) {
    const what = text.silent(topics.ControlState.ageMs(now.value) / 1000);
    return { kind: "bad", advice: [{ what, remedy: text.silentRemedy }] };
  }
  const advice = advise(control, topics.NavigationState.newest.value);
  if (advice.length === 0) {
    const what = control.state === SafetyState.DRIVING ? text.drives : text.ready;
    return { kind: "good", advice: [{ what, remedy: "" }] };
  }
  const isLatched = control.state === SafetyState.FAULT || control.state === SafetyState.EMERGENCY_STOP;
  const isDriving = control.state === SafetyState.DRIVING;
  return { kind: isLatched ? "bad" : isDriving ? "good" : "wait", advice };
}

function unlinked(): Finding {
  if (!access.value) return { kind: "bad", advice: [{ what: text.noAccess, remedy: text.noAccessRemedy }] };
  if (live.closedBecause.value !== "") {
    return { kind: "bad", advice: [{ what: text.tooMany, remedy: live.closedBecause.value }] };
  }
  if (topics.ControlState.newest.value === null) return { kind: "wait", advice: [{ what: text.connecting, remedy: "" }] };
  return { kind: "bad", advice: [{ what: text.noLink, remedy: text.noLinkRemedy }] };
}

/** With a capital and a full stop: the robot's reasons are parts of lines elsewhere. */
function sentence(what: string): string {
  const begun = what.charAt(0).toUpperCase() + what.slice(1);
  return /[.!?…:]$/.test(begun) ? begun : `${begun}.`;
}
