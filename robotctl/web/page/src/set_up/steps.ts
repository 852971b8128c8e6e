// The steps of the set-up that a running robot can prove: what to do, what is seen, and whether it is right.

import type { FunctionComponent } from "preact";

import { nameOf } from "../wire/names";
import { SafetyState, type ControlState, type Hello } from "../wire/messages";
import { words } from "../words";
import { BatteryPicture, LeftPicture, SonarPicture, StopPicture, TiltPicture, WheelPicture } from "./pictures";
import type { Progress } from "./progress";

const text = words.setUp;

export interface Judgement {
  readonly verdict: "waiting" | "ok" | "wrong";
  /** The live value that proves it. */
  readonly value: string;
  /** What is wrong, and the line of the robot's file to change. */
  readonly why?: string;
  readonly line?: string;
}

export interface SetUpStep {
  readonly id: string;
  readonly title: string;
  readonly what: string;
  readonly Picture: FunctionComponent;
  /** What the person says at the end: that it is done, or a number with this label. */
  readonly entry?: "done" | { readonly label: string };
  judge(progress: Progress, entry: number | null): Judgement;
}

/** What the robot's file says of its wheels; null: another kind of robot. */
export interface Wheels {
  readonly radiusM: number | null;
  readonly counts: number | null;
}

const QUARTER = Math.PI / 2;
const DEG = 180 / Math.PI;
const TURNED_DEG = 45;
const TILTED_DEG = 12;
const HAND_M = 0.4;
const HAND_STEP_M = 0.1;
const TURNS = 10;
const ALIKE = 0.02;
const VOLTAGE_SHARE = 0.05;
/** Radius of wheels of which the file says none [m]. */
const ANY_RADIUS_M = 0.05;

export function stepsOf(hello: Hello, control: ControlState, wheels: Wheels): SetUpStep[] {
  const count = control.wheel_distance_m.length;
  return [
    ...Array.from({ length: count }, (_, i) => wheelStep(i, hello.wheels[i] ?? `${i + 1}.`, wheels.radiusM ?? ANY_RADIUS_M)),
    ...(wheels.radiusM === null ? [] : [turnsStep(wheels.radiusM, wheels.counts)]),
    leftStep,
    ...(control.imu === null ? [] : [levelStep]),
    ...hello.sonars.map((_, i) => sonarStep(hello.sonars.map(({ name }) => name), i)),
    batteryStep,
    stopStep,
  ];
}

function wheelStep(wheel: number, name: string, radiusM: number): SetUpStep {
  const said = text.wheel;
  return {
    id: `wheel-${wheel}`,
    title: said.title(name),
    what: said.what(name),
    Picture: WheelPicture,
    judge({ movedM }) {
      const moved = movedM[wheel] ?? 0;
      const value = said.value(moved);
      const enough = QUARTER * radiusM;
      const others = movedM.filter((_, i) => i !== wheel);
      if (moved >= enough) return { verdict: "ok", value };
      if (moved <= -enough) return { verdict: "wrong", value, why: said.wrong, line: said.line };
      if (Math.abs(moved) < 0.2 * enough && others.some((each) => Math.abs(each) >= enough)) {
        return { verdict: "wrong", value, why: said.other, line: said.otherLine };
      }
      return { verdict: "waiting", value };
    },
  };
}

function turnsStep(radiusM: number, counts: number | null): SetUpStep {
  return {
    id: "turns",
    title: text.turns.title,
    what: text.turns.what,
    Picture: WheelPicture,
    entry: "done",
    judge({ movedM }, entry) {
      const moved = movedM.reduce((most, each) => (Math.abs(each) > Math.abs(most) ? each : most), 0);
      const turns = Math.abs(moved) / (4 * QUARTER * radiusM);
      const value = text.turns.value(turns);
      if (entry === null) return { verdict: "waiting", value };
      if (Math.abs(turns / TURNS - 1) <= ALIKE) return { verdict: "ok", value };
      const line = counts === null ? "" : text.turns.line(Math.round((counts * turns) / TURNS));
      return { verdict: "wrong", value, why: `${text.turns.wrong} ${text.turns.bought}`, line };
    },
  };
}

const leftStep: SetUpStep = {
  id: "left",
  title: text.left.title,
  what: text.left.what,
  Picture: LeftPicture,
  judge({ gyroRad, headingRad }) {
    const gyro = gyroRad === null ? null : gyroRad * DEG;
    const heading = headingRad * DEG;
    const value = text.left.value(gyro, heading);
    if (gyro !== null && gyro <= -TURNED_DEG && (heading >= TURNED_DEG || Math.abs(heading) < TURNED_DEG / 4)) {
      return { verdict: "wrong", value, why: text.left.wrongGyro, line: text.left.lineGyro };
    }
    if (heading <= -TURNED_DEG && (gyro ?? TURNED_DEG) >= TURNED_DEG) {
      return { verdict: "wrong", value, why: text.left.wrongWheels, line: text.left.lineWheels };
    }
    const isLeft = heading >= TURNED_DEG && (gyro ?? TURNED_DEG) >= TURNED_DEG;
    return { verdict: isLeft ? "ok" : "waiting", value };
  },
};

const levelStep: SetUpStep = {
  id: "level",
  title: text.level.title,
  what: text.level.what,
  Picture: TiltPicture,
  judge({ newest }) {
    const [x, y, z] = newest.imu?.up ?? [0, 0, 1];
    // Leaning forwards, "up" points backwards in base.
    const [forward, left] = [Math.atan2(-x, z) * DEG, Math.atan2(-y, z) * DEG];
    const value = text.level.value(forward, left);
    if (Math.hypot(forward, left) < TILTED_DEG) return { verdict: "waiting", value };
    if (forward > 2 * Math.abs(left)) return { verdict: "ok", value };
    const off = Math.round(Math.abs(Math.atan2(left, forward)) * DEG);
    return { verdict: "wrong", value, why: text.level.wrong, line: text.level.line(off) };
  },
};

function sonarStep(names: readonly string[], sonar: number): SetUpStep {
  const name = names[sonar] as string;
  return {
    id: `sonar-${sonar}`,
    title: text.sonar.title(name),
    what: text.sonar.what(name),
    Picture: SonarPicture,
    judge({ base, newest }) {
      const seen = (i: number) => {
        const [range, free] = [newest.sonar_m[i] ?? NaN, base.sonar_m[i] ?? NaN];
        return range < HAND_M && !(free - range < HAND_STEP_M);
      };
      const range = newest.sonar_m[sonar] ?? NaN;
      const value = text.sonar.value(Number.isNaN(range) ? null : range);
      if (seen(sonar)) return { verdict: "ok", value };
      const other = names.findIndex((_, i) => i !== sonar && seen(i));
      if (other < 0) return { verdict: "waiting", value };
      const otherName = names[other] as string;
      return { verdict: "wrong", value, why: text.sonar.wrong(otherName), line: text.sonar.line(name, otherName) };
    },
  };
}

const batteryStep: SetUpStep = {
  id: "battery",
  title: text.battery.title,
  what: text.battery.what,
  Picture: BatteryPicture,
  entry: { label: text.battery.meter },
  judge({ newest }, entry) {
    const volts = newest.battery?.voltage_v ?? newest.bus_voltage_v;
    const value = text.battery.value(Number.isFinite(volts) ? volts : null);
    if (entry === null) return { verdict: "waiting", value };
    if (Math.abs(volts - entry) <= VOLTAGE_SHARE * entry) return { verdict: "ok", value };
    return { verdict: "wrong", value, why: text.battery.wrong, line: text.battery.line };
  },
};

const stopStep: SetUpStep = {
  id: "stop",
  title: text.stop.title,
  what: text.stop.what,
  Picture: StopPicture,
  judge({ newest }) {
    const name = nameOf(SafetyState, newest.state);
    const value = text.stop.value(name === null ? "?" : words.states[name]);
    const isStopped = newest.state === SafetyState.EMERGENCY_STOP || newest.state === SafetyState.FAULT;
    return { verdict: isStopped ? "ok" : "waiting", value };
  },
};
