// Plots of any published fields.

import { useEffect, useRef } from "preact/hooks";
import { signal } from "@preact/signals";

import { now } from "../robot/clock";
import { makeChart, resizeChart } from "../plots/chart";
import { fieldNames } from "../plots/fields";
import { choose, chosen, dismiss } from "../plots/history";
import { around, csv, newestS } from "../plots/rows";
import { isReplay } from "../replay/mode";
import { playback } from "../robot/robot";
import { theme } from "../theme";
import { words } from "../words";
import { SearchField } from "./search_field";

const text = words.plots;
const REFRESH_MS = 100;
const MOST_FOUND = 40;
/** Lengths of time that are shown [s]; Infinity: the whole recording. */
const WINDOWS_S = isReplay ? [10, 30, 120, 600, Infinity] : [10, 30, 120, 600];

const isPaused = signal(false);
const windowS = signal<number>(30);
const wanted = signal("");

export function Plots() {
  return (
    <div class="plots">
      <div class="row">
        <button
          type="button"
          hidden={isReplay}
          aria-pressed={isPaused.value}
          onClick={() => {
            isPaused.value = !isPaused.value;
          }}
        >
          {isPaused.value ? text.live : text.pause}
        </button>
        <span role="group" aria-label={text.window} class="row">
          {WINDOWS_S.map((seconds) => (
            <button
              key={seconds}
              type="button"
              aria-pressed={windowS.value === seconds}
              onClick={() => {
                windowS.value = seconds;
              }}
            >
              {text.seconds(seconds)}
            </button>
          ))}
        </span>
        <button type="button" disabled={chosen.value.length === 0} onClick={save}>
          {text.export}
        </button>
      </div>
      {chosen.value.length === 0 ? <p class="empty">{text.none}</p> : <Chart />}
      <ul class="chips">
        {chosen.value.map((field) => (
          <li key={field}>
            {field}
            <button type="button" aria-label={text.remove(field)} onClick={() => dismiss(field)}>
              ×
            </button>
          </li>
        ))}
      </ul>
      <Finder />
    </div>
  );
}

function Chart() {
  const element = useRef<HTMLDivElement>(null);
  const fields = chosen.value;
  const colours = theme.value;
  const seconds = windowS.value;
  useEffect(() => {
    const parent = element.current as HTMLDivElement;
    const style = getComputedStyle(parent);
    const range = () => spanOf(seconds);
    const chart = makeChart(parent, fields, range, style.color, style.getPropertyValue("--line"));
    const resized = new ResizeObserver(() => resizeChart(chart, parent.clientWidth));
    resized.observe(parent);
    const refresh = () => chart.setData(around(fields, isReplay ? shownS() : newestS(fields), spanOf(seconds)));
    refresh();
    const timer = setInterval(() => {
      if (!isPaused.peek() && !document.hidden) refresh();
    }, REFRESH_MS);
    return () => {
      clearInterval(timer);
      resized.disconnect();
      chart.destroy();
    };
  }, [fields, seconds, colours]);
  return <div ref={element} class="chart" role="img" aria-label={text.chart(fields.join(", "))} />;
}

/** Time that is shown of a recording [s]. */
function shownS(): number {
  return (playback.peek()?.at_ns ?? 0) / 1e9;
}

/** What is shown besides the present [s]: the time before it, of a recording also what comes. */
function spanOf(seconds: number): [number, number] {
  if (!isReplay) return [-seconds, 0];
  if (Number.isFinite(seconds)) return [-seconds / 2, seconds / 2];
  return [-shownS(), Math.max((playback.peek()?.end_ns ?? 0) / 1e9 - shownS(), 0.1)];
}

function Finder() {
  void now.value; // fields of messages that came meanwhile
  const part = wanted.value.toLowerCase();
  const found = fieldNames().filter(
    (field) => !chosen.value.includes(field) && field.toLowerCase().includes(part),
  );
  return (
    <div class="finder">
      <SearchField label={text.find} placeholder={text.placeholder} wanted={wanted} />
      <ul>
        {found.slice(0, MOST_FOUND).map((field) => (
          <li key={field}>
            <button type="button" aria-label={text.add(field)} onClick={() => choose(field)}>
              {field}
            </button>
          </li>
        ))}
      </ul>
      {found.length > MOST_FOUND && <p class="hint">{text.more(found.length - MOST_FOUND)}</p>}
    </div>
  );
}

function save(): void {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([csv(chosen.peek())], { type: "text/csv" }));
  link.download = "robotctl.csv";
  link.click();
  URL.revokeObjectURL(link.href);
}
