// A step of the set-point, and how the wheels follow it.

import { useEffect, useRef } from "preact/hooks";
import { signal } from "@preact/signals";

import { isBlind, isDriver, step } from "../driving/driving";
import { STEP_S } from "../driving/step";
import { makeChart, resizeChart } from "../plots/chart";
import { parameter } from "../robot/parameters";
import { driver, hello, topics } from "../robot/robot";
import { theme } from "../theme";
import { coursesOf, figuresOf, type Course } from "../tune/response";
import { ask, response } from "../wire/live";
import { SafetyState } from "../wire/messages";
import { words } from "../words";

const text = words.step;
const LARGEST_SHARE = 0.5;
/** Time for the last states to come to the server [ms]. */
const SETTLE_MS = 300;

const share = signal(0.3);
const isAsking = signal(false);
const isHeld = signal(false);
const note = signal("");

export function StepResponse() {
  const speed = share.value * (parameter("LIM_V_MAX")?.inForce ?? hello.value?.v_max_m_s ?? 0);
  const why = objection();
  return (
    <section class="step" aria-label={text.name}>
      <h2>{text.name}</h2>
      <p class="hint">{text.hint}</p>
      <label class="speed">
        {text.speed}: {text.speedValue(speed)}
        <input
          type="range"
          min="0.1"
          max={LARGEST_SHARE}
          step="0.05"
          value={share.value}
          onInput={(event) => {
            share.value = event.currentTarget.valueAsNumber;
          }}
        />
      </label>
      {isAsking.value ? (
        <Question wayM={speed * (STEP_S + 0.5)} />
      ) : (
        <div class="row">
          <button
            type="button"
            disabled={why !== ""}
            onClick={() => {
              note.value = "";
              response.value = null;
              isAsking.value = true;
            }}
          >
            {text.begin}
          </button>
          {why !== "" && <span class="hint">{why}</span>}
        </div>
      )}
      {note.value !== "" && <p role="status">{note.value}</p>}
      <Result />
    </section>
  );
}

function objection(): string {
  const control = topics.ControlState.newest.value;
  if (!isDriver.value || isBlind.value || control === null) return text.needsSticks;
  if (control.state !== SafetyState.ARMED && control.state !== SafetyState.DRIVING) return text.unarmed;
  return control.wheel_ref_rad_s.every((each) => each === 0) ? "" : text.moves;
}

function wheelName(wheel: number): string {
  return hello.value?.wheels[wheel] ?? text.wheel(wheel);
}

/** The question before anything moves; its button is the dead-man key. */
function Question({ wayM }: { readonly wayM: number }) {
  const timer = useRef<number | undefined>(undefined);
  const begin = () => {
    if (isHeld.peek() || objection() !== "") return;
    isHeld.value = true;
    note.value = "";
    step.begin(share.peek());
    timer.current = window.setTimeout(() => end(step.isHeld), 1000 * STEP_S);
  };
  const end = (isWhole: boolean) => {
    clearTimeout(timer.current);
    if (!isHeld.peek()) return;
    step.letGo();
    isHeld.value = false;
    isAsking.value = false;
    const locked = driver.peek()?.locked ?? "";
    if (locked !== "") note.value = text.refused(locked);
    else if (!isWhole) note.value = text.released;
    else setTimeout(() => ask(text.name, { type: "ResponseRequest" }), SETTLE_MS);
  };
  useEffect(() => () => end(false), []);
  return (
    <div class="confirm" role="alertdialog" aria-label={text.name}>
      <p>{text.question(wayM)}</p>
      <div class="row">
        <button
          type="button"
          class="primary hold"
          onPointerDown={(event) => {
            event.currentTarget.setPointerCapture(event.pointerId);
            begin();
          }}
          onPointerUp={() => end(false)}
          onPointerCancel={() => end(false)}
          onLostPointerCapture={() => end(false)}
          onContextMenu={(event) => event.preventDefault()}
          onKeyDown={(event) => {
            if (event.key !== "Enter") return;
            event.preventDefault();
            if (!event.repeat) begin();
          }}
          onKeyUp={(event) => {
            if (event.key === "Enter") end(false);
          }}
          onBlur={() => end(false)}
        >
          {isHeld.value ? text.running : text.hold}
        </button>
        <button
          type="button"
          onClick={() => {
            isAsking.value = false;
          }}
        >
          {text.cancel}
        </button>
      </div>
    </div>
  );
}

function Result() {
  if (response.value === null) return null;
  const courses = coursesOf(response.value);
  if (courses.length === 0) return <p role="status">{text.still}</p>;
  return (
    <>
      <Chart courses={courses} />
      <Figures courses={courses} />
    </>
  );
}

function Figures({ courses }: { readonly courses: readonly Course[] }) {
  return (
    <table class="nodes" aria-label={text.table}>
      <thead>
        <tr>
          <td />
          <th scope="col">{text.rise}</th>
          <th scope="col">{text.wantedRise}</th>
          <th scope="col">{text.overshoot}</th>
          <th scope="col">{text.steady}</th>
        </tr>
      </thead>
      <tbody>
        {courses.map(figuresOf).map((each, wheel) => (
          <tr key={wheel}>
            <th scope="row">{wheelName(wheel)}</th>
            <td>{text.ms(each.riseS)}</td>
            <td>{text.ms(each.wantedRiseS)}</td>
            <td>{text.percent(each.overshoot)}</td>
            <td>{text.rad_s(each.steadyError)}</td>
          </tr>
        ))}
      </tbody>
    </table>
  );
}

function Chart({ courses }: { readonly courses: readonly Course[] }) {
  const element = useRef<HTMLDivElement>(null);
  const colours = theme.value;
  const shownResponse = response.value;
  useEffect(() => {
    const parent = element.current as HTMLDivElement;
    const style = getComputedStyle(parent);
    const times = courses[0]?.timesS ?? [];
    const fields = courses.flatMap((_, i) => [`.wheel_ref_rad_s[${i}]`, `.wheel_rad_s[${i}]`]);
    const [begin = 0, end = 1] = [times[0], times.at(-1)];
    const line = style.getPropertyValue("--line");
    const labels = courses.flatMap((_, i) => [text.wanted(wheelName(i)), wheelName(i)]);
    const chart = makeChart(parent, fields, [begin, end], style.color, line, labels);
    chart.setData([times, ...courses.flatMap(({ wanted, measured }) => [wanted, measured])] as never);
    const resized = new ResizeObserver(() => resizeChart(chart, parent.clientWidth));
    resized.observe(parent);
    return () => {
      resized.disconnect();
      chart.destroy();
    };
  }, [shownResponse, colours]);
  return <div ref={element} class="chart" role="img" aria-label={text.chart} />;
}
