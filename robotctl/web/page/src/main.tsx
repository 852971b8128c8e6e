// The page: what is on it, and what begins with it.

import { effect } from "@preact/signals";
import { options, render } from "preact";

import "uplot/dist/uPlot.min.css";
import "./page.css";

import { startDriving } from "./driving/driving";
import { Map } from "./map/map";
import { Notices } from "./panels/notices";
import { RefusalToast } from "./panels/refusal";
import { StateBar } from "./panels/state_bar";
import { Stop } from "./panels/stop";
import { Tabs } from "./panels/tabs";
import { Why } from "./panels/why";
import { startEditor } from "./plans/editor";
import { listenToSpace, ReplayBar } from "./replay/bar";
import { Compare } from "./replay/compare";
import { isFrame, isFramed, isReplay } from "./replay/mode";
import { startPlayback } from "./replay/playback";
import { startHistory } from "./plots/history";
import { startTicking } from "./robot/clock";
import { hello } from "./robot/robot";
import { startTheme } from "./theme";
import { openSession } from "./wire/access";
import { startLive } from "./wire/live";
import { startStopLine } from "./wire/stop_line";
import { words } from "./words";

function Page() {
  return (
    <>
      {!isReplay && <Stop />}
      <StateBar />
      <Why />
      <main>
        <Map />
        <div class="side">
          <Tabs />
          <Notices />
        </div>
      </main>
      {isReplay && !isFramed && <ReplayBar />}
      <RefusalToast />
    </>
  );
}

// Panels wait for the next frame: the map is drawn first, and once for all that comes until then.
options.debounceRendering = requestAnimationFrame;

startTheme();
startTicking();
startHistory();
startEditor();
effect(() => {
  document.title = words.title(hello.value?.name ?? null);
});
render(isFrame ? <Compare /> : <Page />, document.getElementById("page") as HTMLElement);
if (isReplay) {
  startPlayback();
  listenToSpace();
} else startDriving();
await openSession();
if (!isReplay) startStopLine();
startLive();
