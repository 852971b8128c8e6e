// The first day of a robot: one look at each thing that may be wired or mounted the wrong way.

import { signal } from "@preact/signals";

import { parameter } from "../robot/parameters";
import { hello, topics, watch } from "../robot/robot";
import { Progress } from "../set_up/progress";
import { stepsOf, type Judgement, type SetUpStep } from "../set_up/steps";
import type { ControlState } from "../wire/messages";
import { words } from "../words";

const text = words.setUp;
/** Time for which a verdict must stand: a single echo may be another sonar's [ns]. */
const STANDS_NS = 300e6;

interface Begun {
  readonly step: SetUpStep;
  readonly progress: Progress;
  readonly judgement: Judgement;
  /** Since when the verdict is this one [ns]. */
  readonly sinceNs: number;
}

/** The step under way; null: none. */
const begun = signal<Begun | null>(null);
const results = signal<ReadonlyMap<string, Judgement>>(new Map());

watch((name, message) => {
  const under = begun.peek();
  if (name !== "ControlState" || under === null) return;
  under.progress.take(message as ControlState);
  judge(under, null);
});

function begin(step: SetUpStep, control: ControlState): void {
  const before = begun.peek();
  if (before !== null && before.judgement.verdict !== "waiting") finish(before);
  const progress = new Progress(control);
  begun.value = { step, progress, judgement: step.judge(progress, null), sinceNs: control.stamp_ns };
}

function judge(under: Begun, entry: number | null): void {
  const { step, progress } = under;
  const judgement = step.judge(progress, entry);
  const stamp = progress.newest.stamp_ns;
  const sinceNs = judgement.verdict === under.judgement.verdict ? under.sinceNs : stamp;
  const isFinal = judgement.verdict !== "waiting" && (entry !== null || stamp - sinceNs >= STANDS_NS);
  begun.value = { step, progress, judgement, sinceNs };
  if (isFinal) finish(begun.value);
}

function finish({ step, judgement }: Begun): void {
  begun.value = null;
  results.value = new Map(results.peek()).set(step.id, judgement);
}

export function SetUp() {
  const robot = hello.value;
  const control = topics.ControlState.newest.value;
  if (robot === null || control === null) return <p class="empty">{text.none}</p>;
  const wheels = {
    radiusM: parameter("GEO_WHEEL_R")?.standard ?? null,
    counts: parameter("GEO_COUNTS")?.standard ?? null,
  };
  return (
    <div class="set-up">
      <p class="hint">{text.hint}</p>
      <ol>
        {stepsOf(robot, control, wheels).map((step) => (
          <Step key={step.id} step={step} control={control} />
        ))}
      </ol>
      <h2>{text.terminal}</h2>
      <p class="hint">{text.terminalHint}</p>
      <dl>
        {text.commands.map(([command, what]) => (
          <>
            <dt>
              <code>{command}</code>
            </dt>
            <dd>{what}</dd>
          </>
        ))}
      </dl>
    </div>
  );
}

function Step({ step, control }: { readonly step: SetUpStep; readonly control: ControlState }) {
  const under = begun.value?.step.id === step.id ? begun.value : null;
  const result = under?.judgement ?? results.value.get(step.id) ?? null;
  const { Picture } = step;
  return (
    <li class={`set-up-step ${result?.verdict ?? ""}`} aria-label={step.title}>
      <Picture />
      <div>
        <h3>{step.title}</h3>
        <p>{step.what}</p>
        {result !== null && (
          <p role="status">
            {result.value} – <b>{text.verdicts[result.verdict]}</b>
          </p>
        )}
        {result?.why !== undefined && (
          <p>
            {result.why} <code>{result.line}</code>
          </p>
        )}
        <div class="row">
          <button type="button" onClick={() => begin(step, control)}>
            {result === null ? text.begin : text.again}
          </button>
          {under !== null && <Entry under={under} />}
        </div>
      </div>
    </li>
  );
}

/** What the person says when a step is done. */
function Entry({ under }: { readonly under: Begun }) {
  const { entry } = under.step;
  if (entry === undefined) return null;
  if (entry === "done") {
    return (
      <button type="button" class="primary" onClick={() => judge(under, 1)}>
        {text.done}
      </button>
    );
  }
  return (
    <label>
      {entry.label}{" "}
      <input
        type="text"
        inputMode="decimal"
        size={6}
        onKeyDown={(event) => {
          const number = Number(event.currentTarget.value.replace(",", "."));
          if (event.key === "Enter" && number > 0) judge(under, number);
        }}
      />
    </label>
  );
}
