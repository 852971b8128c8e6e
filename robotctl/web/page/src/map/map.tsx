// The map and what belongs to it.

import { useEffect, useRef } from "preact/hooks";
import { useSignalEffect } from "@preact/signals";

import { mayDrive } from "../driving/driving";
import { now } from "../robot/clock";
import { isReplay } from "../replay/mode";
import { history } from "../replay/playback";
import { playback, topics, watch, type TopicName } from "../robot/robot";
import { theme } from "../theme";
import { chosen, edited, present } from "../plans/editor";
import { corners } from "../plans/polygons";
import { LocalisationStatus } from "../wire/messages";
import { nameOf } from "../wire/names";
import { words } from "../words";
import { Gestures } from "./gestures";
import { LAYERS } from "./layers/registry";
import { Painter } from "./painter";
import { draft, follows, shown, toggleLayer, tool, TOOLS, view } from "./tools";

const BUTTON_ZOOM = 1.5;
/** Messages that are drawn with the next of another kind: they come with those, and just before. */
const LATER = new Set<TopicName>(["LocalisationState", "NavigationState", "CameraPicture", "RecorderState"]);

export function Map() {
  const canvas = useRef<HTMLCanvasElement>(null);
  const painter = useRef<Painter | null>(null);

  useEffect(() => {
    const element = canvas.current as HTMLCanvasElement;
    const made = new Painter(element);
    painter.current = made;
    new Gestures(element, () => made.request());
    new ResizeObserver(() => made.resize(element.clientWidth, element.clientHeight)).observe(element);
    watch((name) => {
      if (!LATER.has(name)) made.request();
    });
    document.addEventListener("visibilitychange", () => made.request());
  }, []);
  useSignalEffect(() => {
    void [shown.value, follows.value, draft.value, now.value]; // what is old goes grey with time
    void [edited.value, present.value, chosen.value, corners.value, playback.value, history.value];
    painter.current?.request();
  });
  useSignalEffect(() => {
    void theme.value;
    painter.current?.recolour();
  });

  const zoom = (factor: number) => {
    view.zoom(factor);
    painter.current?.request();
  };
  return (
    <section class="map" aria-label={words.map.name}>
      <canvas
        ref={canvas}
        tabIndex={0}
        role="application"
        aria-label={words.map.describe}
        aria-describedby="map-place"
        data-tool={tool.value}
      />
      {!isReplay && <Tools />}
      <div class="map-zoom" role="toolbar" aria-label={words.map.view}>
        <button type="button" aria-label={words.map.zoomIn} onClick={() => zoom(BUTTON_ZOOM)}>
          +
        </button>
        <button type="button" aria-label={words.map.zoomOut} onClick={() => zoom(1 / BUTTON_ZOOM)}>
          −
        </button>
        <button
          type="button"
          onClick={() => {
            follows.value = false;
            painter.current?.fit();
          }}
        >
          {words.map.fit}
        </button>
        <button
          type="button"
          aria-pressed={follows.value}
          onClick={() => {
            follows.value = !follows.value;
          }}
        >
          {words.map.follow}
        </button>
      </div>
      <Layers />
      <Place />
    </section>
  );
}

function Tools() {
  return (
    <div class="map-tools" role="toolbar" aria-label={words.tools.name}>
      {TOOLS.map((each) => (
        <button
          key={each}
          type="button"
          aria-pressed={tool.value === each}
          disabled={each !== "look" && !mayDrive.value}
          title={words.tools.hints[each]}
          onClick={() => {
            tool.value = each;
          }}
        >
          {words.tools[each]}
        </button>
      ))}
    </div>
  );
}

function Layers() {
  return (
    <details class="map-layers">
      <summary>{words.map.layers}</summary>
      <ul>
        {LAYERS.map(({ name }) => (
          <li key={name}>
            <button
              type="button"
              class={`layer layer-${name}`}
              aria-pressed={shown.value[name] === true}
              onClick={() => toggleLayer(name)}
            >
              {words.layers[name]}
            </button>
          </li>
        ))}
      </ul>
    </details>
  );
}

/** How good the map is that the robot makes, and why it is no better. */
function MapVerdict({ said }: { said: string }) {
  const isBad = said !== "good";
  return (
    <span class={isBad ? "map-verdict bad" : "map-verdict"}>
      {isBad && <span aria-hidden="true">⚠ </span>}
      {words.map.verdict(said)}
    </span>
  );
}

/** How well the robot knows where it is, in words. */
function Place() {
  const state = topics.LocalisationState.newest.value;
  const isOld = topics.LocalisationState.isStale(now.value);
  return (
    <p id="map-place" class={isOld && state !== null ? "map-place stale" : "map-place"}>
      {tool.value !== "look" && <strong>{words.tools.hints[tool.value]} </strong>}
      {state === null
        ? words.map.byOdometry
        : words.map.place(
            state.method,
            state.status === LocalisationStatus.LOCALISED,
            words.localisation[nameOf(LocalisationStatus, state.status) ?? "LOST"],
            Math.sqrt(Math.max(0, (state.covariance[0] ?? 0) + (state.covariance[3] ?? 0))),
            state.particles,
          )}
      {state !== null && state.verdict !== "" && <MapVerdict said={state.verdict} />}
    </p>
  );
}
