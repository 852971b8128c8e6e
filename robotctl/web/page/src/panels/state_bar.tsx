// The bar with the state of the robot: what counts, always in sight.

import { now } from "../robot/clock";
import { driver, hello, topics } from "../robot/robot";
import { isReplay } from "../replay/mode";
import { toggleTheme } from "../theme";
import { tripMs } from "../wire/live";
import { BusState, FaultCode, Mode, SafetyState, type ControlState } from "../wire/messages";
import { nameOf } from "../wire/names";
import { words } from "../words";

const text = words.bar;
const LOW_CHARGE = 0.2;
const FULL_BUS = 0.8;

export function StateBar() {
  const control = topics.ControlState.newest.value;
  const isOld = control !== null && topics.ControlState.isStale(now.value);
  const state = control === null ? null : nameOf(SafetyState, control.state);
  return (
    <header class={isOld ? "bar stale" : "bar"} aria-label={text.name}>
      <h1>
        {hello.value?.name ?? "robotctl"}
        {hello.value?.replay != null && <small> {hello.value.replay.name}</small>}
        {hello.value?.simulated === true && <small> {text.simulated}</small>}
      </h1>
      <p class={`pill state-${state ?? "none"}`} role="status">
        <span class="sr">{text.state} </span>
        {state === null ? words.unknown : words.states[state]}
      </p>
      <ModePill />
      <dl class="figures">
        <Battery control={control} />
        <Figure name={text.speed} value={control === null ? null : number(control.v_m_s, 2, " m/s")} />
        <Loop control={control} />
        <Bus control={control} />
        <Nodes control={control} />
        {!isReplay && <Link />}
        {!isReplay && <DriverFigure />}
      </dl>
      {isOld && <p class="age">{words.age(topics.ControlState.ageMs(now.value) / 1000)}</p>}
      <button type="button" class="theme" aria-label={text.theme} title={text.theme} onClick={toggleTheme}>
        ◐
      </button>
    </header>
  );
}

function ModePill() {
  const navigation = topics.NavigationState.newest.value;
  const isOld = topics.NavigationState.isStale(now.value);
  const mode = navigation === null ? null : nameOf(Mode, navigation.mode);
  return (
    <p class={isOld && navigation !== null ? "pill mode stale" : "pill mode"} role="status">
      <span class="sr">{text.mode} </span>
      {mode === null ? words.unknown : words.modes[mode]}
      {navigation !== null && navigation.mode === Mode.AUTO && navigation.items > 0 && (
        <small>
          {" "}
          {navigation.item}/{navigation.items} {navigation.item_name}
        </small>
      )}
    </p>
  );
}

interface FigureProps {
  readonly name: string;
  /** null: not known. */
  readonly value: string | null;
  readonly isBad?: boolean;
}

function Figure({ name, value, isBad = false }: FigureProps) {
  return (
    <div class={isBad ? "figure bad" : "figure"}>
      <dt>{name}</dt>
      <dd>
        {isBad && <span aria-hidden="true">⚠ </span>}
        {value ?? words.unknown}
      </dd>
    </div>
  );
}

interface ControlProps {
  readonly control: ControlState | null;
}

function Battery({ control }: ControlProps) {
  if (control === null) return <Figure name={text.battery} value={null} />;
  const { battery, bus_voltage_v } = control;
  if (battery === null) return <Figure name={text.battery} value={number(bus_voltage_v, 1, " V")} />;
  const charge = `${number(100 * battery.charge, 0, " %")} ${number(battery.voltage_v, 1, " V")}`;
  const isBad = battery.low || battery.critical || battery.charge < LOW_CHARGE;
  return <Figure name={text.battery} value={charge} isBad={isBad} />;
}

function Loop({ control }: ControlProps) {
  const value = control === null ? null : `${number(control.loop.lag_us_p99 / 1000, 2, " ms")} p99`;
  return <Figure name={text.lag} value={value} />;
}

function Bus({ control }: ControlProps) {
  if (control === null) return <Figure name={text.bus} value={null} />;
  const { load, state } = control.bus;
  const isBad = state !== BusState.ERROR_ACTIVE || load > FULL_BUS;
  const trouble = state === BusState.ERROR_ACTIVE ? "" : ` ${nameOf(BusState, state)?.toLowerCase().replace("_", " ")}`;
  return <Figure name={text.bus} value={`${number(100 * load, 0, " %")}${trouble}`} isBad={isBad} />;
}

function Nodes({ control }: ControlProps) {
  if (control === null || control.nodes.length === 0) return null;
  const ok = control.nodes.filter((node) => node.problem === "" && node.fault === FaultCode.NONE).length;
  const all = control.nodes.length;
  return <Figure name={text.nodes} value={text.nodesOk(ok, all)} isBad={ok < all} />;
}

function Link() {
  const trip = tripMs.value;
  return <Figure name={text.link} value={trip === null ? text.noLink : `${trip.toFixed(trip < 10 ? 1 : 0)} ms`} isBad={trip === null} />;
}

function DriverFigure() {
  const { client = null, name = "" } = driver.value ?? {};
  const who = client === null ? text.nobody : client === hello.value?.client ? text.you : name;
  return <Figure name={text.driver} value={who} />;
}

/** A number for people; nothing measured is a dash. */
export function number(value: number, digits: number, unit: string): string {
  return Number.isFinite(value) ? value.toFixed(digits) + unit : words.unknown;
}
