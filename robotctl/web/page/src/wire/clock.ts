// The clocks of server and robot, as the page reckons them from pongs.

import type { Pong } from "./messages";

const KEPT = 20;

const PROOF_MS = 30_000;

/**
 * The server's clock, reckoned so that it is never ahead of the truth: a pong says what its time was
 * at the latest when it came. What the user did is never stamped too young.
 */
export class ProvenClock {
  private proofs: { atMs: number; offsetMs: number }[] = [];

  take(pong: Pong, nowMs: number): void {
    this.proofs = this.proofs.filter((proof) => nowMs - proof.atMs < PROOF_MS);
    this.proofs.push({ atMs: nowMs, offsetMs: pong.server_ns / 1e6 - nowMs });
  }

  reset(): void {
    this.proofs = [];
  }

  /** Server's time [ms] at a time of the page; null before the first pong. */
  at(pageMs: number): number | null {
    if (this.proofs.length === 0) return null;
    return pageMs + Math.max(...this.proofs.map((proof) => proof.offsetMs));
  }
}

/**
 * The robot's clock. It is the server's, but for the pauses that a simulated robot makes: the server's
 * is known by the pong that was back soonest, the pauses so far by the newest one.
 */
export class RobotClock {
  private samples: { tripMs: number; offsetMs: number }[] = [];
  private pausedMs = 0;

  take(pong: Pong, nowMs: number): void {
    const tripMs = nowMs - pong.t;
    this.samples.push({ tripMs, offsetMs: pong.server_ns / 1e6 - (pong.t + tripMs / 2) });
    if (this.samples.length > KEPT) this.samples.shift();
    this.pausedMs = (pong.server_ns - pong.robot_ns) / 1e6;
  }

  reset(): void {
    this.samples = [];
  }

  /** Robot's time [ms] at a time of the page; null until it is known. */
  at(pageMs: number): number | null {
    const offset = this.offsetMs();
    return offset === null ? null : pageMs + offset;
  }

  /** Page's time [ms] at a time of the robot [ns]; null until it is known. */
  pageMs(stampNs: number): number | null {
    const offset = this.offsetMs();
    return offset === null ? null : stampNs / 1e6 - offset;
  }

  private offsetMs(): number | null {
    const first = this.samples[0];
    if (first === undefined) return null;
    return this.samples.reduce((a, b) => (b.tripMs < a.tripMs ? b : a), first).offsetMs - this.pausedMs;
  }
}
