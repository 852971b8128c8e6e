// Colours of the map, from the style sheet, so that light and dark are decided in one place.

const NAMES = [
  "ground",
  "free",
  "wall",
  "robot",
  "trail",
  "particle",
  "covariance",
  "scan",
  "sonar",
  "floor",
  "plan",
  "arc",
  "cost",
  "obstacle",
  "person",
  "goal",
  "truth",
  "line",
  "keepout",
  "slow",
  "fence",
  "place",
  "keyframe",
  "link",
  "loop",
  "mission",
] as const;

export type ColourName = (typeof NAMES)[number];
export type Palette = Readonly<Record<ColourName, string>>;

/** Read the colours that hold now. */
export function readPalette(): Palette {
  const style = getComputedStyle(document.documentElement);
  return Object.fromEntries(
    NAMES.map((name) => [name, style.getPropertyValue(`--map-${name}`).trim()]),
  ) as Record<ColourName, string>;
}
