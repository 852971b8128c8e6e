// Pointer, wheel and keys on the map: pan, zoom, pinch, and the tools.

import type { Point } from "../robot/se2";
import { draft, follows, grip, tool, use, view } from "./tools";

/** Pointers that move less than this are clicks [px]. */
const CLICK_PX = 8;
const WHEEL_ZOOM = 0.0015;
const KEY_ZOOM = 1.25;
const KEY_PAN_PX = 40;
const KEY_TURN_RAD = Math.PI / 12;

export class Gestures {
  private readonly pointers = new Map<number, Point>();
  private begin: Point | null = null;
  private pans = false;
  private aimRad: number | null = null;

  constructor(
    private readonly canvas: HTMLCanvasElement,
    private readonly redraw: () => void,
  ) {
    canvas.addEventListener("pointerdown", (event) => this.down(event));
    canvas.addEventListener("pointermove", (event) => this.move(event));
    canvas.addEventListener("pointerup", (event) => this.up(event));
    canvas.addEventListener("pointercancel", (event) => this.cancel(event));
    canvas.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("keydown", (event) => this.key(event));
    canvas.addEventListener("blur", () => this.drop());
  }

  private down(event: PointerEvent): void {
    this.canvas.setPointerCapture(event.pointerId);
    const at: Point = [event.offsetX, event.offsetY];
    this.pointers.set(event.pointerId, at);
    this.pans = this.pointers.size > 1 || event.button !== 0 || tool.peek() === "look";
    this.begin = this.pans ? null : at;
    const place = view.toWorld(...at);
    draft.value = this.begin === null ? null : { at: place, heading_rad: null, grip: grip(place) };
    this.redraw();
  }

  private move(event: PointerEvent): void {
    const before = this.pointers.get(event.pointerId);
    if (before === undefined) return;
    const at: Point = [event.offsetX, event.offsetY];
    const other = [...this.pointers].find(([id]) => id !== event.pointerId)?.[1];
    this.pointers.set(event.pointerId, at);
    if (other !== undefined) this.pinch(before, at, other);
    else if (this.begin !== null) this.aim(this.begin, at);
    else if (this.pans) this.pan(at[0] - before[0], at[1] - before[1]);
    this.redraw();
  }

  private up(event: PointerEvent): void {
    const chosen = draft.peek();
    this.cancel(event);
    if (chosen !== null) use(chosen);
  }

  private cancel(event: PointerEvent): void {
    this.pointers.delete(event.pointerId);
    this.begin = null;
    this.drop();
  }

  private drop(): void {
    draft.value = null;
    this.aimRad = null;
    this.redraw();
  }

  private pan(dx: number, dy: number): void {
    follows.value = false;
    view.pan(dx, dy);
  }

  private pinch(before: Point, at: Point, other: Point): void {
    const apart = (point: Point) => Math.max(1, Math.hypot(point[0] - other[0], point[1] - other[1]));
    this.pan((at[0] - before[0]) / 2, (at[1] - before[1]) / 2);
    view.zoom(apart(at) / apart(before), (at[0] + other[0]) / 2, (at[1] + other[1]) / 2);
  }

  private aim(begin: Point, at: Point): void {
    const [dx, dy] = [at[0] - begin[0], at[1] - begin[1]];
    const held = draft.peek()?.grip;
    if (held !== undefined) {
      if (Math.hypot(dx, dy) >= CLICK_PX) draft.value = { at: view.toWorld(...at), heading_rad: null, grip: held };
      return;
    }
    const heading_rad = Math.hypot(dx, dy) < CLICK_PX ? null : Math.atan2(-dy, dx);
    draft.value = { at: view.toWorld(...begin), heading_rad };
  }

  private wheel(event: WheelEvent): void {
    event.preventDefault();
    view.zoom(Math.exp(-WHEEL_ZOOM * event.deltaY), event.offsetX, event.offsetY);
    this.redraw();
  }

  /** Keys: arrows pan, + and - zoom, [ and ] turn the aim, Enter uses the tool in the middle. */
  private key(event: KeyboardEvent): void {
    if (event.shiftKey && event.key.startsWith("Arrow")) return; // those drive
    if (!this.obeys(event.key)) return;
    event.preventDefault();
    if (tool.peek() !== "look") {
      draft.value = { at: view.toWorld(view.width / 2, view.height / 2), heading_rad: this.aimRad };
    }
    this.redraw();
  }

  private obeys(key: string): boolean {
    switch (key) {
      case "ArrowLeft":
        this.pan(KEY_PAN_PX, 0);
        return true;
      case "ArrowRight":
        this.pan(-KEY_PAN_PX, 0);
        return true;
      case "ArrowUp":
        this.pan(0, KEY_PAN_PX);
        return true;
      case "ArrowDown":
        this.pan(0, -KEY_PAN_PX);
        return true;
      case "+":
      case "=":
        view.zoom(KEY_ZOOM);
        return true;
      case "-":
        view.zoom(1 / KEY_ZOOM);
        return true;
      case "[":
        this.aimRad = (this.aimRad ?? 0) + KEY_TURN_RAD;
        return true;
      case "]":
        this.aimRad = (this.aimRad ?? 0) - KEY_TURN_RAD;
        return true;
      case "Enter":
        use({ at: view.toWorld(view.width / 2, view.height / 2), heading_rad: this.aimRad });
        this.aimRad = null;
        return true;
      default:
        return false;
    }
  }
}
