// The camera's picture, and what the robot makes of it. It is sent only while this panel is open.

import { effect } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";

import { readPalette } from "../map/palette";
import { now } from "../robot/clock";
import { topics } from "../robot/robot";
import { live } from "../wire/live";
import type { CameraPicture } from "../wire/messages";
import { words } from "../words";

const text = words.camera;

export function Camera() {
  const canvas = useRef<HTMLCanvasElement>(null);
  useEffect(() => {
    const ask = () => live.send({ type: "WatchCamera", watch: !document.hidden });
    const stopAsking = live.isOpen.subscribe((isOpen) => {
      if (isOpen) ask();
    });
    document.addEventListener("visibilitychange", ask);
    const stopDrawing = effect(() => {
      const picture = topics.CameraPicture.newest.value;
      if (picture !== null) void draw(canvas.current as HTMLCanvasElement, picture);
    });
    return () => {
      stopAsking();
      stopDrawing();
      document.removeEventListener("visibilitychange", ask);
      live.send({ type: "WatchCamera", watch: false });
      topics.CameraPicture.forget();
    };
  }, []);
  const picture = topics.CameraPicture.newest.value;
  const isOld = topics.CameraPicture.isStale(now.value);
  return (
    <div class={isOld && picture !== null ? "camera stale" : "camera"}>
      <canvas ref={canvas} role="img" aria-label={text.describe} hidden={picture === null} />
      {picture === null ? <p class="empty">{text.none}</p> : <p>{picture.trouble || text.legend}</p>}
      {isOld && picture !== null && <p>{words.age(topics.CameraPicture.ageMs(now.value) / 1000)}</p>}
    </div>
  );
}

/** Draw a picture, and over it where the floor ends and what stands on it. */
async function draw(canvas: HTMLCanvasElement, picture: CameraPicture): Promise<void> {
  const image = await createImageBitmap(new Blob([picture.jpeg as BlobPart], { type: "image/jpeg" }));
  if (topics.CameraPicture.newest.peek() !== picture) return;
  canvas.width = picture.width;
  canvas.height = picture.height;
  const context = canvas.getContext("2d") as CanvasRenderingContext2D;
  context.drawImage(image, 0, 0);
  const { scan, plan, obstacle } = readPalette();
  context.lineWidth = 3;
  trace(context, picture.floor, plan);
  trace(context, picture.boundary, scan);
  context.strokeStyle = obstacle;
  for (const [u, v, width] of picture.things) context.strokeRect(u - width / 2, v - width / 2, width, width / 2);
}

/** A line from left to right, with gaps where nothing is known. */
function trace(
  context: CanvasRenderingContext2D,
  points: readonly (readonly [number, number] | null)[],
  colour: string,
): void {
  context.beginPath();
  let isDown = false;
  for (const point of points) {
    if (point !== null && isDown) context.lineTo(...point);
    else if (point !== null) context.moveTo(...point);
    isDown = point !== null;
  }
  context.strokeStyle = colour;
  context.stroke();
}
