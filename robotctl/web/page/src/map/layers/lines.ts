import type { Layer } from "./layer";

const FINEST_PX = 24;
const STEPS_M = [0.5, 1, 5, 10, 50, 100];

/** Lines by metres, as fine as can be told apart. */
export const lines: Layer = {
  name: "lines",
  isShown: true,
  draw({ context, colours, pixel, view }) {
    const step = STEPS_M.find((each) => each * view.scale >= FINEST_PX);
    if (step === undefined) return;
    const [left, top] = view.toWorld(0, 0);
    const [right, bottom] = view.toWorld(view.width, view.height);
    context.beginPath();
    for (let x = Math.ceil(left / step) * step; x < right; x += step) {
      context.moveTo(x, bottom);
      context.lineTo(x, top);
    }
    for (let y = Math.ceil(bottom / step) * step; y < top; y += step) {
      context.moveTo(left, y);
      context.lineTo(right, y);
    }
    context.strokeStyle = colours.line;
    context.lineWidth = pixel;
    context.stroke();
  },
};
