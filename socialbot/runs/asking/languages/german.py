"""German questions and answers."""

import re

from socialbot.runs.asking.languages.language import Language, Voices, word_set

GERMAN = Language(
    "de",
    {
        "why": (
            "warum,wieso,weshalb,weswegen,aus welchem grund,welchen grund,was war der grund,grund,wozu,erklare,"
            "wie kommt es,was brachte dich dazu,was hat dich dazu gebracht,was hat dich veranlasst,"
            "wie hast du entschieden,woher wusstest du,woher weisst du,worauf beruht,was hat dich bewogen,"
            "auf welcher grundlage,wieso denn,aufgrund wovon,wie kam es,was war der anlass,anlass"
        ),
        "what": (
            "was,irgendwas,etwas,beschreibe,wie hast du reagiert,wie hast du dich verhalten,was ist mit,"
            "erzahl mir von,welcher,welches,welchen,welche,welchem"
        ),
        "who": (
            "wer,wen,wem,wessen,welche leute,welche person,welche personen,welche besucher,welcher roboter,"
            "welcher agent"
        ),
        "when": "wann,um welche zeit,zu welcher zeit,zu welchem zeitpunkt,seit wann",
        "how_often": "wie oft,wie haufig,wie viele male,wieviele male,wie viel mal,wie viele mal",
        "how_many": "wie viele,wieviele,wie viel,anzahl,wie vielen,wie vieler,wieviel",
        "unanswerable": (
            "wie alt,welche farbe,wie heisst,wie hiess,wie schnell,wie gross,wie,wem gehort,wem gehoren,"
            "wem gehorte,gehort"
        ),
        "not": "nicht,nie,niemals,kein,keine,keinen,keiner,vergessen,versaumt,unterlassen",
        "see": (
            "siehst,sehen,gesehen,sahst,sieht,sah,erkennst,erkannt,bemerkt,bemerkst,im blick,vor dir,sichtbar,"
            "wahrgenommen,beobachtest,beobachtet,kamera,sahen,sehe,seht,erblickt,erblickte,entdeckt"
        ),
        "do": (
            "tust,machst,tun,getan,gemacht,tat,machte,tatest,macht,beschaftigt,treibst,tut,unternommen,reagiert,"
            "verhalten,taten,machten,machtest,treibt,trieb,unternahm"
        ),
        "happen": "passiert,geschehen,geschieht,passierte,geschah,los",
        "next": "als nachstes,nachstes,danach,dann,nachste,anschliessend,gleich",
        "plan": (
            "noch zu tun,noch etwas zu tun,noch zu erledigen,planst,vor,vorhast,willst,wirst,ziel,absicht,plan,"
            "plane,ziele,mochtest,beabsichtigst,werdet,wollt,"
            "wollen,vorhabt,vorhaben"
        ),
        "outcome": (
            "ende,endete,beendet,fertig,erfolg,erfolgreich,gelungen,gelang,geschafft,geklappt,ergebnis,abgeschlossen,"
            "gut gelaufen,gut gegangen,glatt gelaufen,glatt gegangen,nach plan"
        ),
        "fail": (
            "schief,schiefgegangen,schiefgelaufen,fehler,problem,probleme,gescheitert,scheitern,scheiterte,misslungen,"
            "fehlgeschlagen,schwierigkeiten,panne,pannen,unfall,unfalle,zwischenfall,zwischenfalle,storung,"
            "hangen geblieben"
        ),
        "say": (
            "sagst,gesagt,sagen,sagtest,gesprochen,sagte,satz,worte,satze,sprachst,sprach,sprechen,sprichst,spricht,"
            "sagten,sage,redest,geredet,erzahlt,erzahltest,erzahlte,geantwortet,antwortest,antwortetest,antwortete,"
            "gefragt,fragtest,fragte,gebeten,batest,bat,erwahnt,erwahntest"
        ),
        "hear": "gehort,hortest,horst,hore,hort,hast gehort,vernommen",
        "replies": "geantwortet,antwortete,antwortetest,antworte,antwortet,erwidert,erwiderte",
        "asks": "gefragt,fragtest,fragte,fragen,gebeten,batest,bat,bitten,verlangt",
        "here": (
            "hier,da,gekommen,kam,kamen,besucht,anwesend,vorbei,vorbeigekommen,aufgetaucht,dort,gegangen,geblieben,"
            "blieb,bleiben,ging,stand,gestanden,weggegangen,verschwunden,kamst,ankommen,angekommen,kommt,losgegangen"
        ),
        "people": (
            "leute,leuten,person,personen,besucher,besucherin,mann,frau,gast,gaste,mensch,menschen,jemand,jemanden,kind"
        ),
        "group": "paar",
        "nobody": "niemand,niemanden,leer",
        "me": "mich,mir,ich,uns,wir",
        "you": "du,dich,dir,roboter,ihr",
        "them": "ihn,ihm,sie,ihnen,er,diesen mann,diese frau",
        "past": (
            "kam,kamen,gekommen,sah,sahst,hast,habe,hat,haben,hattest,war,waren,wart,wurde,wurden,wurdest,bist,schon,"
            "vorher,bisher,blieb,stand,ging,geschah,passierte,sagtest,tatest,machtest,machte,machten,tat,taten,warst"
        ),
        "future": "wirst,werden,als nachstes,nachstes,vorhast",
        "present": "ist,sind,kannst,jetzt,gerade,derzeit,momentan,siehst,machst,tust",
        "ago": "vor",
        "first": "erste,ersten,erster,erstes,zuerst,erstmals",
        "last": "letzte,letzten,letzter,letztes,zuletzt,vorige",
        "ordinals": "zweite,dritte,vierte,funfte,sechste,siebte,achte,neunte,zehnte",
        "time": "mal",
        "seconds": "s,sek,sekunde,sekunden",
        "minutes": "min,minute,minuten",
        "at": "bei,nach,um,in,ab",
        "end": "am ende,am schluss,zum schluss,ganz am ende,gegen ende,kurz vor dem ende,schliesslich,endlich",
        "overall": "insgesamt,bisher,bislang",
        "talk": "sprechen,gesprochen,reden,geredet",
        "silent": "still,stumm,schweigsam,geschwiegen,schweigen,zuruckgehalten,wortlos",
        "request": "kannst du,konntest du,bitte,wurdest du",
        "start": "am anfang,zu beginn,anfangs",
        "recently": "gerade eben,soeben,gerade,jetzt,eben",
        "how_long": (
            "wie lange,seit wann,wie viele sekunden,wie viele minuten,wieviele sekunden,wie viel zeit,wieviel zeit,"
            "wie schnell,wie lange hat es gedauert,wie lange dauerte es"
        ),
        "where": "wo,wohin,woher,an welchem ort",
        "how_far": "wie weit,wie weit weg,wie nah,wie nahe,welche entfernung,in welcher entfernung",
        "auxiliary": "hast,hat,haben,habt,bist,ist,sind,warst,war,waren,wurde,wurden,kannst",
        "all": "alle,allen,jeder,jeden,jedem,beide,beiden",
        "shortest": "am kurzesten,kurzeste,kurzesten",
        "longest": "am langsten,langste,langsten",
        "but": "aber,und,wahrend,doch,jedoch",
        "rather": "statt,anstatt,anstelle von,und nicht,aber nicht",
        "event after": "nachdem,sobald,nach dem,nach der,nach,spater als",
        "event before": "bevor,ehe,bis,und dann,und danach,vor dem,vor der,vor,fruher als,eher als",
        "follows": "folgte auf,folgt auf,kam nach,kam direkt nach,kam gleich nach",
        "precedes": "kam vor,kam direkt vor",
        "event when": "als,wenn,wahrend",
        "comes": "kam,kamen,kommt,gekommen,ankam,erschien,erschienen,auftauchte,hereinkam,eintrat",
        "leaves": "ging,gingen,geht,gegangen,wegging,verschwand,verschwunden,verliess,verlassen,weg,fort",
        "waits": "warten,gewartet,gezogert",
        "matrix": (
            "wissen,weiss,weisst,sagen,sag,sage,sagst,erinnerst,erinnern,frage,fragen,interessiert,interessieren,"
            "horen,erfahren,verstehe,verstehen,sicher,ahnung,erklaren,mochte,wurde,gern,gerne,verraten,verratst,nennen,"
            "neugierig,wundere,klar,schon,nett,freundlich,erzahlen,stimmt,wundert"
        ),
        "or": "oder",
        "which": "welcher,welches,welchen,welche,welchem",
        "why not": "warum nicht,wieso nicht",
        "complement": "ob,stimmt es dass,wahr dass,richtig dass,sicher dass",
        "times": (
            "einmal,zweimal,dreimal,viermal,mehrmals,mehrfach,ofter,wieder,nochmal,nochmals,noch mal,erneut,immer,"
            "jedes mal,jedesmal,stets,mehrere male"
        ),
        "others": (
            "sonst,sonst noch,anderen,andere,anderem,ausser,nur,ausschliesslich,lediglich,bloss,abgesehen von,"
            "die meisten,den meisten,alles,niemanden ausser"
        ),
        "hypothetical": (
            "was ware,was wenn,ware passiert,was hattest du,wurdest du tun,wurde passieren,hatte passieren konnen"
        ),
        "qualified": (
            "weil,zusammen,gleichzeitig,fruher,spater,eher,statt,anstatt,zu spat,zu fruh,zu lange,zu oft,"
            "rechtzeitig,kaum,fast,beinahe,sofort,aus versehen,um zu,eine frau,einen mann,ein kind,frauen,"
            "manner,kinder,auf deutsch,auf englisch"
        ),
        "filler": (
            "entschuldigung,entschuldige,entschuldigen sie,verzeihung,bezuglich,ah,ahm,gab,gibt,bekam,bekommen,"
            "bekommt,erhielt,erhalten,kriegte,gekriegt,bitteschon,heute,hm,na,naja,"
            "also,ach,ubrigens,tja,mir,wohl,eben,halt,bitte,gerade,tatsachlich,stattgefunden,eigentlich,genau,"
            "ausgerechnet,moment,zeitpunkt,fall,bild,oder,richtig,bitte,hallo,hey,sag mir,kannst du mir sagen,"
            "konntest du mir sagen,weisst du,ich mochte wissen,der,die,das,den,dem,ein,eine,einen,einem,einer,zu,zum,"
            "zur,fur,mit,und,von,es,denn,eigentlich,an,auf,am,im,in,so,doch,mal,je,jemals,ob,dass,insgesamt,auch,"
            "noch,nur,wieder,sekunde,ja,dazu,des,nun,alle,alles,aufgehort,dort,welche,uberhaupt,als,ding,sache,bloss,"
            "einfach,zusammen,brauchte,brauche,sich,du,aber,einmal,dich,zwischendurch,dazwischen,team,"
            "dein,deine,deinen,deinem,deiner,deines,mein,meine,meinen,meinem,meiner,meines,sein,seine,seinen,seinem,"
            "seiner,seines,ihre,ihren,ihrem,ihrer,unser,unsere,euer,eure,mitten in der arbeit,mitten in deiner arbeit,"
            "mitten bei der arbeit,wahrend der arbeit"
        ),
        "left out": (
            "nichts,leer aus,leer ausgegangen,ausgelassen,ausgeschlossen,ubergangen,ubersehen,leeren handen,"
            "nicht bedacht,zu kurz,vergessen"
        ),
        "between": "zwischen",
        "called": "namens,mit namen,mit dem namen,genannt",
        "step": "schritt,schritte,schritten,planschritt",
        "replan": (
            "neuen plan,neuer plan,neu planen,neu geplant,umplanen,umgeplant,anderen plan,anderer plan,"
            "plan geandert,plan andern,plan gewechselt,zweiten plan,zweiter plan"
        ),
        "to": "zu,zur,zum,nach,in,ins,auf,an",
        "from": "von,vom,aus,verlassen,verliess",
        "article": "der,die,das,den,dem,ein,eine,einen,einem",
        "being": "ist,war,sind,waren,gewesen,gab es,gibt es,befand sich",
        "at place": "in,im,innerhalb,drin,auf,unter,uber,hinter,vor,neben,zwischen,bei,an,am",
    },
    {
        "because": ", denn",
        "decimal": ",",
        "and": "und",
        "at": "bei {at} s",
        "within": "von {at} bis {until} s: {clause}",
        "ago": "vor {ago} Sekunden",
        "just_now": "gerade eben",
        "then": "{when}: {clause}",
        "person": "Person {id}",
        "somebody": "jemand",
        "anybody": "irgendjemanden",
        "yes": "Ja",
        "no": "Nein",
        "unknown": "Das weiß ich nicht",
        "unclear": "Ich verstehe die Frage nicht sicher",
        "able": (
            "Ich kann sagen, warum ich etwas tat oder ließ, was ich sah, sagte, tat und vorhatte, und wer wann hier war"
        ),
        "not_recorded": "die Aufzeichnung sagt es nicht",
        "belief": "ich glaubte {what}",
        "no_belief": "ich glaubte nicht {what}",
        "saw_none": "ich sah niemanden",
        "saw_one": "ich sah {people}",
        "away": "{person} in {distance} m Entfernung",
        "side": "{person} {side} des Bildes",
        "sides": "auf der linken Seite|in der Mitte|auf der rechten Seite",
        "nobody_came": "niemand war hier",
        "here": "{person} war von {at} bis {until} s hier",
        "here_you": "du warst von {at} bis {until} s hier",
        "counted": "{count} Personen waren hier",
        "counted_one": "eine Person war hier",
        "times": "{count} Mal",
        "people": "{count} Personen",
        "people_one": "eine Person",
        "times_one": "einmal",
        "said": "ich sagte „{what}“",
        "heard": "{person} sagte „{what}“",
        "heard_you": "du sagtest „{what}“",
        "failed": "mir misslang {what}{why}",
        "ended": "der Plan für {what} endete: {outcome}{why}",
        "nothing_failed": "nichts misslang",
        "took": "das dauerte {value} s",
        "said_nothing": "ich sagte nichts",
        "not_named": "die Aufzeichnung erwähnt „{word}“ nicht",
        "said_no_words": "ich sagte nicht „{what}“",
        "nothing_next": "ich hatte keine Absicht",
        "next_was": "das Nächste war {when}: {clause}",
        "last_was": "das Letzte war {when}: {clause}",
        "nothing_done": "ich tat gerade nichts",
        "wanted": "ich wollte {what}",
        "assumes": "Ich halte dich für Person {id}.",
        "examples": (
            "Was siehst du? | Was hast du bei Sekunde {at} gemacht? | Wer war hier? | Was machst du als Nächstes?"
        ),
    },
    Voices(
        you=word_set("du ihr"),
        to_you=word_set("dich dir euch"),
        passive=word_set("wurdest wurde wurden worden"),
        by=word_set("von"),
        receive=word_set("bekommen bekam bekamst erhalten erhielt gekriegt kriegtest empfangen"),
        source=word_set("von"),
        third=word_set("hat haben hatte hatten"),
        participle=re.compile(".*t|.*ge.*en"),
        first=word_set("habe"),
    ),
    letters="äöüß",
)
