// A WebSocket that comes back by itself. What could not be sent at once is lost, and never sent later.

import { signal } from "@preact/signals";

import { decode } from "./msgpack";
import type { Pong, Sent, Stop } from "./messages";
import { revive } from "./revive";

export interface Tagged {
  readonly type: string;
}

const FIRST_WAIT_MS = 200;
const LONGEST_WAIT_MS = 2000;
const PING_MS = 500;
const SILENCE_MS = 2500;
/** Bytes that wait in the browser, beyond which the link is late and nothing more is added to them. */
const BACKLOG = 16_384;

/** A line to the server; `onMessage` is called with each message, pongs included. */
export class Line {
  readonly isOpen = signal(false);
  /** Words in which the server ended the last connection; empty: it did not say why. */
  readonly closedBecause = signal("");
  /** Called when an open connection ends. */
  onClose: () => void = () => {};
  /** Called when one could not be had at all. */
  onRefused: () => void = () => {};

  private socket: WebSocket | null = null;
  private receivedMs = -Infinity;
  private waitMs = FIRST_WAIT_MS;

  constructor(
    private readonly path: string,
    private readonly onMessage: (message: Tagged) => void,
  ) {}

  start(): void {
    this.connect();
    setInterval(() => this.attend(), PING_MS);
  }

  /** Send now, or not at all; return whether it was sent. */
  send(message: Sent | Stop): boolean {
    if (this.socket?.readyState !== WebSocket.OPEN || this.socket.bufferedAmount > BACKLOG) return false;
    this.socket.send(JSON.stringify(message));
    return true;
  }

  private connect(): void {
    const scheme = location.protocol === "https:" ? "wss:" : "ws:";
    const socket = new WebSocket(`${scheme}//${location.host}${this.path}`);
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    socket.onopen = () => {
      this.waitMs = FIRST_WAIT_MS;
      this.receivedMs = performance.now();
      this.isOpen.value = true;
      this.closedBecause.value = "";
      this.ping();
    };
    socket.onmessage = (event: MessageEvent<ArrayBuffer>) => {
      this.receivedMs = performance.now();
      for (const message of decode(new Uint8Array(event.data)) as Tagged[]) this.onMessage(revive(message.type, message) as Tagged);
    };
    socket.onclose = (event) => {
      if (socket === this.socket && event.reason !== "") this.closedBecause.value = event.reason;
      this.lose(socket);
    };
  }

  /** Give up a connection and make another; the old one's own end comes too late to matter. */
  private lose(socket: WebSocket): void {
    if (socket !== this.socket) return;
    this.socket = null;
    if (this.isOpen.value) {
      this.isOpen.value = false;
      this.onClose();
    } else {
      this.onRefused();
    }
    setTimeout(() => this.connect(), this.waitMs);
    this.waitMs = Math.min(2 * this.waitMs, LONGEST_WAIT_MS);
  }

  private attend(): void {
    const socket = this.socket;
    if (socket === null || !this.isOpen.value) return;
    if (performance.now() - this.receivedMs > SILENCE_MS) {
      socket.close();
      this.lose(socket);
    } else {
      this.ping();
    }
  }

  private ping(): void {
    this.send({ type: "Ping", t: performance.now() });
  }
}

/** Time there and back of a pong that comes now [ms]. */
export function roundTripMs(pong: Pong): number {
  return performance.now() - pong.t;
}
