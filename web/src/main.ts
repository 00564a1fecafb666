import { start } from "./frame";
import "./style.css";
import { restoreTheme } from "./theme";
import { VIEWS } from "./views";

restoreTheme();
start(VIEWS);
