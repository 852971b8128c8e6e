// A chart of fields: fields of one unit share a scale, the first two units have an axis.

import uPlot from "uplot";

import { unitOf } from "./fields";

/** Colours that the colour-blind can tell (Okabe and Ito, 2008), the light ones first on dark ground. */
const COLOURS = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9"];
const DASHES: readonly number[][] = [[], [8, 4], [2, 3]];
const HEIGHT = 260;

export function makeChart(
  element: HTMLElement,
  fields: readonly string[],
  range: uPlot.Scale.Range,
  ink: string,
  grid: string,
  labels: readonly string[] = fields.map((field) => field.slice(field.indexOf(".") + 1)),
): uPlot {
  const scaleOf = (field: string) => unitOf(field) || "1";
  const scales = [...new Set(fields.map(scaleOf))];
  const axis = (scale: string, side: uPlot.Axis.Side): uPlot.Axis => ({
    scale,
    side,
    label: scale === "1" ? "" : scale,
    labelSize: scale === "1" ? 0 : 18,
    size: 48,
    stroke: ink,
    grid: { show: side === 3, stroke: grid, width: 1 },
    ticks: { stroke: grid, width: 1 },
  });
  const [left, right] = scales;
  return new uPlot(
    {
      width: element.clientWidth,
      height: HEIGHT,
      scales: {
        x: { time: false, range },
        ...Object.fromEntries(scales.map((scale) => [scale, { range: spread }])),
      },
      cursor: { drag: { x: false, y: false } },
      hooks: { drawAxes: [(chart) => markPresent(chart, ink)] },
      legend: { live: true },
      series: [
        { label: "t", value: (_, value) => (value === null ? "–" : `${value.toFixed(2)} s`) },
        ...fields.map((field, i) => ({
          label: labels[i] ?? field,
          scale: scaleOf(field),
          stroke: COLOURS[i % COLOURS.length] ?? ink,
          dash: DASHES[Math.floor(i / COLOURS.length) % DASHES.length] ?? [],
          width: 2,
          spanGaps: true,
          points: { show: false },
          value: (_: uPlot, value: number | null) => (value === null ? "–" : value.toPrecision(4)),
        })),
      ],
      axes: [
        {
          stroke: ink,
          grid: { stroke: grid, width: 1 },
          ticks: { stroke: grid, width: 1 },
        },
        ...(left === undefined ? [] : [axis(left, 3)]),
        ...(right === undefined ? [] : [axis(right, 1)]),
      ],
    },
    [[], ...fields.map(() => [])],
    element,
  );
}

/** A line where the present is, between what was and what comes. */
function markPresent({ ctx, bbox, valToPos }: uPlot, ink: string): void {
  const x = Math.round(valToPos(0, "x", true));
  if (x <= bbox.left || x >= bbox.left + bbox.width) return;
  ctx.fillStyle = ink;
  ctx.fillRect(x, bbox.top, devicePixelRatio, bbox.height);
}

/** Range of an axis: room above and below, also around a value that stands still. */
function spread(_: uPlot, low: number | null, high: number | null): [number, number] {
  if (low === null || high === null) return [0, 1];
  const room = Math.max(0.1 * (high - low), 0.02 * Math.max(Math.abs(low), Math.abs(high)), 0.01);
  return [low - room, high + room];
}

export function resizeChart(chart: uPlot, width: number): void {
  chart.setSize({ width, height: HEIGHT });
}
