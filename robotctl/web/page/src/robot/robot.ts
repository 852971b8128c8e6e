// What the page knows of the robot: the newest of each kind of message.

import { signal } from "@preact/signals";

import type {
  BoundsView,
  CameraPicture,
  CameraView,
  ComputerState,
  ControlState,
  Driver,
  GivenMap,
  Hello,
  LidarScan,
  LiveMap,
  LocalisationState,
  MissionView,
  NavigationState,
  Notice,
  ParticleCloud,
  PlanView,
  Playback,
  Pong,
  Received,
  RecorderState,
  Refused,
  SlamGraph,
  Response,
  Saved,
  StopSeen,
  Truth,
} from "../wire/messages";
import { describe, takeValues } from "./parameters";
import { isReplay } from "../replay/mode";
import { playback, Topic, type Stamped } from "./topic";
import { Trail } from "./trail";
import { WorldPose } from "./world_pose";
import type { Pose } from "./se2";

const MOST_NOTICES = 500;

export const topics = {
  ControlState: new Topic<ControlState>(),
  NavigationState: new Topic<NavigationState>(),
  LocalisationState: new Topic<LocalisationState>(),
  LidarScan: new Topic<LidarScan>(),
  CameraView: new Topic<CameraView>(),
  ParticleCloud: new Topic<ParticleCloud>(),
  PlanView: new Topic<PlanView>(),
  LiveMap: new Topic<LiveMap>(),
  GivenMap: new Topic<GivenMap>(),
  RecorderState: new Topic<RecorderState>(),
  Truth: new Topic<Truth>(),
  SlamGraph: new Topic<SlamGraph>(),
  MissionView: new Topic<MissionView>(),
  BoundsView: new Topic<BoundsView>(),
  CameraPicture: new Topic<CameraPicture>(),
};

export type TopicName = keyof typeof topics;

export const hello = signal<Hello | null>(null);
export const driver = signal<Driver | null>(null);
export const computer = signal<ComputerState | null>(null);
/** Newest last. */
export const notices = signal<readonly Notice[]>([]);

export { playback };

export const worldPose = new WorldPose();
export const trail = new Trail();

type News = Exclude<Received, Pong | Refused | Response | Saved | StopSeen>;
type Watcher = (name: TopicName, message: Stamped) => void;
const watchers: Watcher[] = [];

/** Call back with each message of a topic. */
export function watch(watcher: Watcher): void {
  watchers.push(watcher);
}

/** `base` in `world` now; null if that is unknown. */
export function pose(): Pose | null {
  const control = topics.ControlState.newest.peek();
  return control === null ? null : worldPose.pose(control);
}

/** Take one message of the robot, or of the server about it. */
export function take(message: News): void {
  switch (message.type) {
    case "Hello":
      greet(message);
      break;
    case "Driver":
      driver.value = message;
      break;
    case "Playback":
      show(message);
      break;
    case "Notice":
      note(message);
      break;
    case "ComputerState":
      computer.value = message;
      break;
    case "ParameterTable":
      describe(message);
      break;
    case "ParameterValues":
      takeValues(message);
      break;
    case "ControlState":
      publish("ControlState", message);
      follow(message);
      break;
    case "LocalisationState":
      worldPose.localise(message);
      publish("LocalisationState", message);
      break;
    default:
      publish(message.type, message);
  }
}

/** Take the time that is shown of a recording; what there is none of then is forgotten. */
function show(message: Playback): void {
  for (const [name, topic] of Object.entries(topics)) {
    if (!message.topics.includes(name)) topic.forget();
  }
  playback.value = message;
}

/** Keep a notice; with a connection some come that are known already. */
function note(notice: Notice): void {
  const known = notices.peek();
  if (known.some(({ stamp_ns, text }) => stamp_ns === notice.stamp_ns && text === notice.text)) return;
  notices.value = [...known, notice].slice(-MOST_NOTICES);
}

/** Begin with a connection: the server says all that is known now, and nothing else counts. */
function greet(message: Hello): void {
  const before = hello.peek();
  if (before !== null && before.version !== message.version) location.reload(); // to that version's page
  hello.value = message;
  worldPose.reset(message.has_localiser);
  for (const topic of Object.values(topics)) topic.forget();
  if (before !== null && before.name !== message.name) {
    trail.clear();
    notices.value = [];
  }
}

function publish<Name extends TopicName>(name: Name, message: Stamped): void {
  (topics[name] as Topic<Stamped>).take(message, performance.now());
  for (const watcher of watchers) watcher(name, message);
}

function follow(control: ControlState): void {
  const here = worldPose.pose(control);
  if (here !== null && !isReplay) trail.add(here, worldPose.epoch(control));
}
