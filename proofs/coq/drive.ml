(* The extracted machine behind the line protocol of `fuseline drive` (SPEC.md, section 6). Nothing here is proved:
   it turns lines into inputs and decisions into lines. With the argument `--batch` answers are written when the buffer
   is full, for whoever does not wait for them. *)
open Machine

(* Numbers of 64 bits, and those of Coq *)
let rec positive_of u =
  let half = Int64.shift_right_logical u 1 and odd = Int64.logand u 1L = 1L in
  if half = 0L then XH else if odd then XI (positive_of half) else XO (positive_of half)
let n_of u = if u = 0L then N0 else Npos (positive_of u)
let rec of_positive = function
  | XH -> 1L
  | XO p -> Int64.shift_left (of_positive p) 1
  | XI p -> Int64.logor 1L (Int64.shift_left (of_positive p) 1)
let text = function
  | N0 -> "0"
  | Npos p ->
    let u = of_positive p in
    if u < 0L then Printf.sprintf "%Lu" u else Int64.to_string u

(* As much of JSON as the protocol needs *)
type json = Number of n | Text of string | List of json list | Object of (string * json) list | Other
let parse s =
  let i = ref 0 in
  let peek () = s.[!i] and next () = incr i in
  let rec blank () = if !i < String.length s && String.contains " \t\r\n" s.[!i] then (next (); blank ()) in
  let quoted () =
    let b = Buffer.create 8 in
    next ();
    while peek () <> '"' do
      if peek () = '\\' then (Buffer.add_char b '\\'; next ());
      Buffer.add_char b (peek ());
      next ()
    done;
    next ();
    Buffer.contents b in
  let many close item =
    next ();
    blank ();
    let rec go found =
      if peek () = close then (next (); List.rev found)
      else begin
        let x = item () in
        blank ();
        if peek () = ',' then (next (); blank ());
        go (x :: found)
      end in
    go [] in
  let rec value () =
    blank ();
    match peek () with
    | '"' -> Text (quoted ())
    | '[' -> List (many ']' value)
    | '{' -> Object (many '}' (fun () -> let k = quoted () in blank (); next (); let v = value () in (k, v)))
    | _ ->
      let from = !i in
      while !i < String.length s && not (String.contains ",]} \t\r\n" s.[!i]) do next () done;
      (match Int64.of_string_opt ("0u" ^ String.sub s from (!i - from)) with
       | Some u -> Number (n_of u)
       | None -> Other) in
  value ()
let get o k = match o with Object l -> List.assoc_opt k l | _ -> None
let number o k = match get o k with Some (Number n) -> n | _ -> failwith ("no number " ^ k)
let optional o k = match get o k with Some (Number n) -> Some n | _ -> None

let header o =
  let cloud c = cloud_with (number c "p") (number c "limit") (optional c "resume") in
  let clouds = match get o "clouds" with Some (List l) -> List.map cloud l | _ -> [] in
  let rule = match get o "commit" with
    | Some (Text "patient") -> Patient
    | Some (Text "progressive") -> Progressive
    | _ -> Eager in
  { window = number o "window"; rule; clouds }
let input o =
  let t () = number o "t" and p () = number o "p" in
  let what = match get o "ev" with
    | Some (Text "open") -> Open (t (), optional o "deadline")
    | Some (Text "offer") -> Offer (t (), p (), number o "deadline", number o "backlog")
    | Some (Text "result") -> Result (t (), p ())
    | Some (Text "fail") -> Fail (t (), p ())
    | Some (Text "tick") -> Tick
    | _ -> failwith "no input" in
  { at_ = number o "at"; what }

let reason = function
  | Order -> "order" | Full -> "full" | Deadline -> "deadline" | Unknown -> "unknown" | Closed -> "closed"
  | Duplicate -> "duplicate" | Outranked -> "outranked" | Queue -> "queue" | Superseded -> "superseded"
  | Unsolicited -> "unsolicited" | Late -> "late"
let write d =
  let line ev at t rest =
    List.iter print_string ["{\"ev\":\""; ev; "\",\"at\":"; text at; ",\"t\":"; text t; rest; "}\n"] in
  let p x = ",\"p\":" ^ text x and why w = ",\"why\":\"" ^ reason w ^ "\"" in
  match d with
  | Opened _ | Failed _ -> ()
  | Timer (a, t, q) -> line "timer" a t (p q)
  | Refuse (a, t, None, w) -> line "refuse" a t (why w)
  | Refuse (a, t, Some q, w) -> line "refuse" a t (p q ^ why w)
  | Request (a, t, q, due) -> line "request" a t (p q ^ ",\"due\":" ^ text due)
  | Hold (a, t, q) -> line "hold" a t (p q)
  | Drop (a, t, q, w) -> line "drop" a t (p q ^ why w)
  | Emit (a, t, q) -> line "emit" a t (p q)
  | Final (a, t, q) -> line "final" a t (p q)
  | Miss (a, t) -> line "miss" a t ""
  | Cancel (a, t, q) -> line "cancel" a t (p q)

let waits = Sys.argv <> [| Sys.argv.(0); "--batch" |]
let rec loop config state =
  match input_line stdin with
  | exception End_of_file -> ()
  | line ->
    let o = parse line in
    let config, state, decisions =
      if get o "fuseline" <> None then header o, initial, []
      else let state, decisions = step config state (input o) in config, state, decisions in
    List.iter write decisions;
    print_string "{\"ev\":\"done\"}\n";
    if waits then flush stdout;
    loop config state
let () = loop { window = N0; rule = Eager; clouds = [] } initial
