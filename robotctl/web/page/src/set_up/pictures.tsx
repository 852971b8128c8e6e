// Pictures of the set-up, in the colours of the theme.

import type { ComponentChildren } from "preact";

/** A picture; what is in `class="hot"` is what moves. */
function Picture({ children }: { readonly children: ComponentChildren }) {
  return (
    <svg class="picture" viewBox="0 0 96 64" aria-hidden="true">
      {children}
    </svg>
  );
}

/** Head of an arrow at a place, turned by degrees from pointing to the right. */
function Head({ x, y, deg }: { readonly x: number; readonly y: number; readonly deg: number }) {
  return <path class="head" d="M0 0 L-9 -5 L-9 5 Z" transform={`translate(${x} ${y}) rotate(${deg})`} />;
}

/** The robot from above, which looks up. */
function Body() {
  return (
    <>
      <rect x="33" y="18" width="30" height="36" rx="5" />
      <rect class="wheel" x="26" y="29" width="6" height="16" rx="2" />
      <rect class="wheel" x="64" y="29" width="6" height="16" rx="2" />
      <path d="M43 26 L48 21 L53 26" />
    </>
  );
}

/** From the side, front to the right: the wheel's upper side goes forward. */
export function WheelPicture() {
  return (
    <Picture>
      <rect x="16" y="16" width="64" height="20" rx="5" />
      <circle class="wheel" cx="44" cy="42" r="15" />
      <line x1="6" y1="58" x2="90" y2="58" />
      <g class="hot">
        <path d="M30 32 A17 17 0 0 1 58 32" />
        <Head x={62} y={38} deg={62} />
        <path d="M70 8 H84" />
        <Head x={90} y={8} deg={0} />
      </g>
    </Picture>
  );
}

export function LeftPicture() {
  return (
    <Picture>
      <Body />
      <g class="hot">
        <path d="M78 22 A34 34 0 0 0 26 14" />
        <Head x={18} y={20} deg={142} />
      </g>
    </Picture>
  );
}

/** From the side, front to the right: the nose goes down. */
export function TiltPicture() {
  return (
    <Picture>
      <line x1="6" y1="58" x2="90" y2="58" />
      <g transform="rotate(18 62 50)">
        <rect x="20" y="20" width="56" height="18" rx="5" />
        <circle class="wheel" cx="34" cy="40" r="10" />
        <circle class="wheel" cx="64" cy="40" r="10" />
      </g>
      <g class="hot">
        <path d="M66 8 A24 24 0 0 1 86 22" />
        <Head x={89} y={31} deg={76} />
      </g>
    </Picture>
  );
}

/** A hand in the cone before the robot. */
export function SonarPicture() {
  return (
    <Picture>
      <rect x="6" y="20" width="30" height="24" rx="5" />
      <path class="cone" d="M36 32 L84 12 A52 52 0 0 1 84 52 Z" />
      <g class="hot">
        <path d="M66 50 V26 a3 3 0 0 1 6 0 v-4 a3 3 0 0 1 6 0 v4 a3 3 0 0 1 6 0 v22 z" />
      </g>
    </Picture>
  );
}

export function BatteryPicture() {
  return (
    <Picture>
      <rect x="10" y="22" width="42" height="28" rx="4" />
      <path d="M18 22 v-6 M44 22 v-6 M15 32 h8 M39 32 h10 M44 27 v10" />
      <g class="hot">
        <circle cx="76" cy="36" r="14" />
        <path d="M76 36 L83 28 M18 12 C30 2 62 4 68 24 M44 12 C52 8 60 12 64 28" />
      </g>
    </Picture>
  );
}

export function StopPicture() {
  return (
    <Picture>
      <rect x="22" y="40" width="52" height="16" rx="4" />
      <path class="mushroom" d="M30 34 a18 12 0 0 1 36 0 z" />
      <path d="M42 34 v6 h12 v-6" />
      <g class="hot">
        <path d="M48 2 V10" />
        <Head x={48} y={18} deg={90} />
      </g>
    </Picture>
  );
}
