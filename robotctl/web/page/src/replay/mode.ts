// Whether this page shows recordings in place of a robot: their server says so in the page itself.

/** Number of recordings; 0: a robot. */
export const runs = Number(document.documentElement.dataset["replay"] ?? 0);
export const isReplay = runs > 0;

const chosen = new URLSearchParams(location.search).get("run");

/** What the requests of this page end with, so that they are about its recording. */
export const query = isReplay && chosen !== null ? `?run=${chosen}` : "";
/** Whether this page is the frame around two others. */
export const isFrame = runs > 1 && chosen === null;
/** Whether this page is within such a frame, which has the bar. */
export const isFramed = runs > 1 && chosen !== null;
