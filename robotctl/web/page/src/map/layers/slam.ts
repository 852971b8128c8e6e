import { topics } from "../../robot/robot";
import type { Point } from "../../robot/se2";
import { floats } from "../../wire/msgpack";
import type { SlamGraph } from "../../wire/messages";
import { dots } from "./drawing";
import type { Layer, Scene } from "./layer";

/** Keyframes of SLAM, their links, and the loops that it closed; the newest graph holds until the next. */
export const slam: Layer = {
  name: "slam",
  isShown: true,
  draw(scene) {
    const graph = topics.SlamGraph.newest.peek();
    if (graph === null) return;
    const nodes = keyframes(graph);
    edges(scene, nodes, graph.links, scene.colours.link, 1.5);
    edges(scene, nodes, graph.loops, scene.colours.loop, 3);
    dots(scene, nodes, scene.colours.keyframe, 4);
  },
};

function keyframes({ poses }: SlamGraph): Point[] {
  const values = floats(poses);
  return Array.from({ length: values.length / 3 }, (_, i) => [values[3 * i] ?? 0, values[3 * i + 1] ?? 0] as const);
}

function edges({ context, pixel }: Scene, nodes: Point[], packed: Uint8Array, colour: string, width: number): void {
  const ends = new DataView(packed.buffer, packed.byteOffset, packed.byteLength);
  context.beginPath();
  for (let i = 0; i + 7 < packed.byteLength; i += 8) {
    const [a, b] = [nodes[ends.getInt32(i, true)], nodes[ends.getInt32(i + 4, true)]];
    if (a === undefined || b === undefined) continue;
    context.moveTo(...a);
    context.lineTo(...b);
  }
  context.strokeStyle = colour;
  context.lineWidth = width * pixel;
  context.stroke();
}
