// All layers of the map, those beneath first.

import { arc } from "./arc";
import { costs } from "./costs";
import { covariance } from "./covariance";
import { fence } from "./fence";
import { floor } from "./floor";
import { givenMap } from "./given_map";
import { goal } from "./goal";
import type { Layer } from "./layer";
import { lines } from "./lines";
import { liveMap } from "./live_map";
import { mission } from "./mission";
import { obstacles } from "./obstacles";
import { particles } from "./particles";
import { people } from "./people";
import { places, returns } from "./places";
import { plan } from "./plan";
import { robot } from "./robot";
import { scan } from "./scan";
import { slam } from "./slam";
import { sonar } from "./sonar";
import { trail } from "./trail";
import { truth } from "./truth";
import { zones } from "./zones";

export const LAYERS: readonly Layer[] = [
  givenMap,
  liveMap,
  lines,
  costs,
  zones,
  fence,
  places,
  returns,
  slam,
  trail,
  sonar,
  particles,
  scan,
  floor,
  obstacles,
  people,
  plan,
  arc,
  mission,
  goal,
  truth,
  covariance,
  robot,
];
