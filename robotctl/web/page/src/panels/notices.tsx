// The history of notices, the newest first.

import { useComputed } from "@preact/signals";

import { isReplay } from "../replay/mode";
import { clock } from "../robot/clock";
import { notices } from "../robot/robot";
import { tripMs } from "../wire/live";
import { words } from "../words";

const text = words.notices;

/** Numbers of RFC 5424. */
const CRITICAL = 2;
const WARNING = 4;
const NOTICE = 5;

const SIGNS = { critical: "✖", warning: "▲", notice: "●", information: "·" } as const;

export function Notices() {
  return (
    <section class="card notices" aria-labelledby="notices">
      <h2 id="notices">{text.name}</h2>
      {notices.value.length === 0 ? <p class="empty">{text.none}</p> : <History />}
    </section>
  );
}

function History() {
  void useComputed(() => tripMs.value !== null).value; // times are known once the clock is
  return (
    <ol tabIndex={0} aria-labelledby="notices">
      {[...notices.value].reverse().map((notice) => {
        const severity = severityOf(notice.severity);
        return (
          <li key={`${notice.stamp_ns} ${notice.text}`} class={`notice-${severity}`}>
            <time>{timeOf(notice.stamp_ns)}</time>
            <span class="sign" role="img" aria-label={text.severities[severity]}>
              {SIGNS[severity]}
            </span>
            <span class="text">{notice.text}</span>
          </li>
        );
      })}
    </ol>
  );
}

function severityOf(number: number): keyof typeof SIGNS {
  if (number <= CRITICAL) return "critical";
  if (number <= WARNING) return "warning";
  return number <= NOTICE ? "notice" : "information";
}

/** Time of day at this page's place. */
function timeOf(stampNs: number): string {
  if (isReplay) return words.replay.clock(stampNs / 1e9);
  const pageMs = clock.pageMs(stampNs);
  return pageMs === null ? "" : new Date(performance.timeOrigin + pageMs).toLocaleTimeString([], { hour12: false });
}
