// The panels beside the map, one at a time.

import { signal } from "@preact/signals";
import type { FunctionComponent } from "preact";

import { isReplay } from "../replay/mode";
import { words } from "../words";
import { Bounds } from "./bounds";
import { Camera } from "./camera";
import { Drive } from "./drive";
import { Mission } from "./mission";
import { Nodes } from "./nodes";
import { Plots } from "./plots";
import { SetUp } from "./set_up";
import { Tune } from "./tune";
import { Recordings } from "./recordings";

/** To add a panel: its file and its line here, its name in words.ts. */
const PANELS: Readonly<Record<Exclude<keyof typeof words.tabs, "name">, FunctionComponent>> = {
  drive: Drive,
  plots: Plots,
  nodes: Nodes,
  mission: Mission,
  bounds: Bounds,
  camera: Camera,
  tune: Tune,
  setUp: SetUp,
  recordings: Recordings,
};

type PanelName = keyof typeof PANELS;
/** Panels that command a robot: there is none in a replay. */
const COMMANDING = new Set<PanelName>(["drive", "mission", "bounds", "camera", "tune", "setUp", "recordings"]);
const NAMES = (Object.keys(PANELS) as PanelName[]).filter((name) => !isReplay || !COMMANDING.has(name));

const open = signal<PanelName>(isReplay ? "plots" : "drive");

export function Tabs() {
  const Panel = PANELS[open.value];
  return (
    <section class="card tabs">
      <div role="tablist" aria-label={words.tabs.name} onKeyDown={onArrow}>
        {NAMES.map((name) => (
          <button
            key={name}
            type="button"
            role="tab"
            id={`tab-${name}`}
            aria-selected={open.value === name}
            aria-controls="panel"
            tabIndex={open.value === name ? 0 : -1}
            onClick={() => {
              open.value = name;
            }}
          >
            {words.tabs[name]}
          </button>
        ))}
      </div>
      <div id="panel" role="tabpanel" aria-labelledby={`tab-${open.value}`} tabIndex={0}>
        <Panel />
      </div>
    </section>
  );
}

/** Arrows go from tab to tab; with Shift they drive. */
function onArrow(event: KeyboardEvent): void {
  const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
  if (step === undefined || event.shiftKey) return;
  const next = NAMES[(NAMES.indexOf(open.value) + step + NAMES.length) % NAMES.length];
  if (next === undefined) return;
  open.value = next;
  document.getElementById(`tab-${next}`)?.focus();
}
