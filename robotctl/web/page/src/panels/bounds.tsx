// Zones and the fence: what the robot keeps to, and how they are drawn.

import { mayDrive } from "../driving/driving";
import { tool } from "../map/tools";
import {
  close,
  corners,
  FEWEST,
  name,
  removeCircle,
  removePolygon,
  removeZone,
  shape,
  SHAPES,
  speed_m_s,
  surrounds,
} from "../plans/polygons";
import { pose, topics } from "../robot/robot";
import { words } from "../words";

const text = words.bounds;

export function Bounds() {
  const bounds = topics.BoundsView.newest.value;
  if (bounds === null) return <p class="empty">{text.unknown}</p>;
  const [polygons, circles] = bounds.fence;
  return (
    <div class="bounds">
      <ul class="items">
        {bounds.zones.map((zone) => (
          <li key={`${zone.origin} ${zone.name}`}>
            <span>
              {text.zone(zone.name, zone.speed_m_s)} <small>{text.origins[zone.origin as keyof typeof text.origins]}</small>
            </span>
            {zone.origin === "map" && <Remove what={zone.name} remove={() => void removeZone(zone.name)} />}
          </li>
        ))}
        {polygons.map(([points, keeps_in], i) => (
          <li key={`polygon ${i}`}>
            <span>{text.polygon(keeps_in, points.length)}</span>
            <Remove what={text.polygon(keeps_in, points.length)} remove={() => removePolygon(i)} />
          </li>
        ))}
        {circles.map(([, , radius, keeps_in], i) => (
          <li key={`circle ${i}`}>
            <span>{text.circle(keeps_in, radius)}</span>
            <Remove what={text.circle(keeps_in, radius)} remove={() => removeCircle(i)} />
          </li>
        ))}
      </ul>
      {bounds.zones.length + polygons.length + circles.length === 0 && <p class="empty">{text.none}</p>}
      {mayDrive.value && (corners.value === null ? <Begin /> : <Drawing />)}
      <p class="hint">{text.meaning}</p>
    </div>
  );
}

function Remove({ what, remove }: { what: string; remove: () => void }) {
  if (!mayDrive.value) return null;
  return (
    <button type="button" aria-label={text.remove(what)} onClick={remove}>
      ×
    </button>
  );
}

function Begin() {
  return (
    <button
      type="button"
      onClick={() => {
        corners.value = [];
        tool.value = "corner";
      }}
    >
      {text.draw}
    </button>
  );
}

function Drawing() {
  const points = corners.value ?? [];
  const end = () => {
    if (corners.peek() === null) tool.value = "look";
  };
  return (
    <div class="drawing">
      <label>
        {text.kind}
        <select value={shape.value} onChange={(event) => (shape.value = event.currentTarget.value as typeof shape.value)}>
          {SHAPES.map((each) => (
            <option key={each} value={each}>
              {text.kinds[each]}
            </option>
          ))}
        </select>
      </label>
      {(shape.value === "keepOut" || shape.value === "slow") && (
        <label>
          {text.name}
          <input maxLength={60} value={name.value} onInput={(event) => (name.value = event.currentTarget.value)} />
        </label>
      )}
      {shape.value === "slow" && (
        <label>
          {text.speed}
          <input
            type="number"
            min="0.05"
            step="0.05"
            value={speed_m_s.value}
            onChange={(event) => (speed_m_s.value = event.currentTarget.valueAsNumber)}
          />
        </label>
      )}
      <p role="status">{warning() || text.corners(points.length)}</p>
      <div class="row">
        <button type="button" class="primary" disabled={points.length < FEWEST} onClick={() => void close().then(end)}>
          {text.close}
        </button>
        <button type="button" disabled={points.length === 0} onClick={() => (corners.value = points.slice(0, -1))}>
          {text.undo}
        </button>
        <button
          type="button"
          onClick={() => {
            corners.value = null;
            end();
          }}
        >
          {text.cancel}
        </button>
      </div>
    </div>
  );
}

/** What the robot does that would stand where it should not. */
function warning(): string {
  const points = corners.value ?? [];
  const here = pose();
  if (points.length < FEWEST || here === null || shape.value === "slow") return "";
  const isWrong = surrounds(points, here) !== (shape.value === "fenceIn");
  if (!isWrong) return "";
  return shape.value === "keepOut" ? text.inZone : text.beyondFence;
}
